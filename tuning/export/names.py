"""Which names an export may have: of files, of a C library, of a Python module, of a ROS 2 package, at once."""

from __future__ import annotations

import builtins
import keyword
import re
import sys

from agvjax import Fault

LONGEST = 63  # characters that C99 tells apart in a name
C_WORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long"
    " register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"
    " alignas alignof and and_eq asm atomic_cancel atomic_commit atomic_noexcept bitand bitor bool catch char8_t"
    " char16_t char32_t class co_await co_return co_yield compl concept const_cast consteval constexpr constinit"
    " decltype delete dynamic_cast explicit export false friend mutable namespace new noexcept not not_eq nullptr"
    " operator or or_eq private protected public reflexpr reinterpret_cast requires static_assert static_cast"
    " synchronized template this thread_local throw true try typeid typename typeof typeof_unqual using virtual"
    " wchar_t xor xor_eq".split()
)
C_HEADERS = frozenset(
    "assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg stdatomic"
    " stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype"
    " unistd pthread".split()
)
FILES = frozenset("main vectors single config resource setup package src include".split())  # of the exports themselves
MODULES = frozenset(  # what an export imports, or what runs beside it does
    "numpy scipy jax jaxlib agvjax tuning yaml setuptools pkg_resources pip wheel matplotlib pandas lxml"
    " catkin_pkg empy rclpy rclcpp launch launch_ros launch_xml launch_yaml launch_testing ament_index_python"
    " ament_package colcon_core rpyutils rosidl_runtime_py rosidl_parser rosidl_adapter rosidl_cli"
    " rosidl_pycommon tf2 tf2_ros tf2_py nav2_common ros2cli ros2launch ros2run ros2topic ros2param ros2node"
    " ros2pkg nav2 nav2_core nav2_costmap_2d nav2_controller nav2_util nav2_ros_common nav2_bringup nav_2d_utils"
    " rclcpp_lifecycle rclcpp_components pluginlib class_loader generate_parameter_library ament_cmake rsl fmt"
    " osrf_pycommon domain_coordinator message_filters cv_bridge tf_transformations xacro urdf".split()
)
MESSAGES = ("_msgs", "_srvs", "_actions", "_interfaces")  # how packages of messages are called
KINDS = (
    (C_WORDS, "a word of C or C++"),
    (C_HEADERS, "a header of C"),
    (frozenset(keyword.kwlist) | frozenset(keyword.softkwlist), "a word of Python"),
    (frozenset(sys.stdlib_module_names), "a module of Python"),
    (frozenset(dir(builtins)), "built into Python"),
    (MODULES, "a package that robots or the export itself import"),
    (FILES, "a file or folder of an export"),
)


def faults(name: str) -> list[Fault]:
    """What keeps `--name` from being the name of an export, of any form."""
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name):
        return [_fault(name, "lower-case letters, digits and single underscores, a letter first")]
    if not 2 <= len(name) <= LONGEST:
        return [_fault(name if len(name) < 2 else f"{name[:20]}...", f"2 to {LONGEST} characters, not {len(name)}")]
    taken = [what for words, what in KINDS if name in words]
    taken += ["how ROS calls a package of messages"] * name.endswith(MESSAGES)
    return [_fault(name, f"a name of its own: this one is {taken[0]}")] if taken else []


def _fault(name: str, rule: str) -> Fault:
    return Fault("--name", name, rule)


def check_members(kind: str, members: list[str]) -> None:
    """Members of a structure of C.

    Raises:
        ValueError: one is no name, or a word, of C or C++, or two are the same.
    """
    for member in members:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", member) or member in C_WORDS or "__" in member:
            raise ValueError(f"{kind} has the name {member[:40]!r}, which is none, or a word, of C or C++")
        if len(member) > LONGEST:
            raise ValueError(
                f"{kind} has the name {member[:20]}... of {len(member)} characters, C tells {LONGEST} apart"
            )
    if twice := sorted({member for member in members if members.count(member) > 1}):
        raise ValueError(f"{kind} would have the name {twice[0]} twice in C")
