"""agvjax."""

from .controllers import NeuroBackstepping as NeuroBackstepping
from .evaluate import Batch as Batch
from .evaluate import batch as batch
from .evaluate import evaluate as evaluate
from .metrics import Criteria as Criteria
from .metrics import measure as measure
from .scenario import Scenario as Scenario
from .simulate import simulate as simulate
