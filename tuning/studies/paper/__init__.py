"""The paper's tables and figures rebuilt, each number beside the printed one; `agvjax reproduce`."""
