"""Headers that stand for ROS 2 and Nav2, the code that stands for generate_parameter_library's, and a server."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import yaml

DATA = Path(__file__).parents[1] / "data" / "nav2_plugin"
HEADERS = """
nav2_core/controller.hpp nav2_core/controller_exceptions.hpp rclcpp_lifecycle/lifecycle_node.hpp
pluginlib/class_list_macros.hpp tf2_geometry_msgs/tf2_geometry_msgs.hpp
""".split()
WARNINGS = ["-Wall", "-Wextra", "-Werror", "-Wpedantic"]
COMPILERS = {"gcc": ("gcc", "g++"), "clang": ("clang", "clang++")}
RULES = {  # what generate_parameter_library checks, as C++ of the value x
    "gt": "x[0] > {}", "gt_eq": "x[0] >= {}", "lt": "x[0] < {}", "lt_eq": "x[0] <= {}",
    "bounds": "x[0] >= {} && x[0] <= {}", "fixed_size": "x.size() == {}",
    "element_bounds": "within(x, {}, {})", "lower_element_bounds": "within(x, {}, HUGE_VAL)",
    "upper_element_bounds": "within(x, -HUGE_VAL, {})",
}  # fmt: skip
KINDS = {"double": "double", "double_array": "std::vector<double>", "bool": "bool"}
LISTENER = """#pragma once
#include "ros.hpp"
namespace {space}
{{
inline bool within(const std::vector<double> & x, double low, double high)
{{
  for (double part : x) {{if (!(part >= low && part <= high)) {{return false;}}}}
  return !x.empty() || low < high;
}}
struct Params
{{
{members}
  long stamp = -1;
}};
class ParamListener
{{
public:
  using Node = rclcpp_lifecycle::LifecycleNode;
  using Numbers = Node::Numbers;
  ParamListener(std::shared_ptr<Node> node, const std::string & prefix) : node_(node), prefix_(prefix + ".")
  {{
{declared}
  }}
  bool is_old(const Params & params) const {{return params.stamp != node_->changes;}}
  Params get_params() const
  {{
    Params found;
    found.stamp = node_->changes;
{read}
    return found;
  }}

private:
  void declare(const std::string & name, Numbers value, bool fixed, std::function<bool(const Numbers &)> allowed)
  {{
    const auto given = node_->launched.find(prefix_ + name);
    if (given != node_->launched.end()) {{value = given->second;}}
    const auto rule = [=](const Numbers & x) {{
        return fixed ? std::string("read only") : allowed(x) ? std::string() : name + " is out of bounds";
      }};
    if (!allowed(value)) {{throw std::runtime_error(name + " is out of bounds");}}
    node_->held[prefix_ + name] = value;
    node_->rules[prefix_ + name] = rule;
  }}
  std::shared_ptr<Node> node_;
  std::string prefix_;
}};
}}
"""


def listener(text):
    """The header that stands for the one that generate_parameter_library makes of a parameters.yaml."""
    ((space, tree),) = yaml.safe_load(text).items()
    members, declared, read = [], [], []

    def walk(table, path, indent):
        for name, part in table.items():
            if not isinstance(part.get("type"), str):
                members.append(f"{indent}struct")
                members.append(f"{indent}{{")
                walk(part, (*path, name), indent + "  ")
                members.append(f"{indent}}} {name};")
                continue
            dotted, kind = ".".join((*path, name)), KINDS[part["type"]]
            members.append(f"{indent}{kind} {name}{{}};")
            value = part["default_value"]
            values = value if isinstance(value, list) else [float(value)]
            assert all(type(x) is float for x in values), f"{dotted} is no double"
            rules = [RULES[rule[:-2]].format(*map(repr, ends)) for rule, ends in part.get("validation", {}).items()]
            allowed = f"[](const Numbers & x) {{(void)x; return {' && '.join(rules) or 'true'};}}"
            fixed = str(part.get("read_only", False)).lower()
            declared.append(f'    declare("{dotted}", {{{", ".join(map(repr, values))}}}, {fixed}, {allowed});')
            held = f'node_->held.at(prefix_ + "{dotted}")'
            read.append(f"    found.{dotted} = {held}{'' if 'vector' in kind else '[0]'}{' != 0' * (kind == 'bool')};")

    walk(tree, (), "  ")
    return LISTENER.format(space=space, members="\n".join(members), declared="\n".join(declared), read="\n".join(read))


def lay_out(folder, files, name, lyrical=False):
    """Write a package and what it includes into a folder."""
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    stub = folder / "stub"
    for header in HEADERS + ["nav2_ros_common/lifecycle_node.hpp"] * lyrical:
        (stub / header).parent.mkdir(parents=True, exist_ok=True)
        (stub / header).write_text('#include "ros.hpp"\n')
    shutil.copy(DATA / "ros.hpp", stub)
    (stub / name).mkdir()
    (stub / name / f"{name}_parameters.hpp").write_text(listener(files["src/parameters.yaml"]))


NEEDS = """
generate_parameter_library geometry_msgs nav_msgs nav2_core nav2_costmap_2d pluginlib rclcpp rclcpp_lifecycle tf2
tf2_geometry_msgs tf2_ros
""".split()
FOUND = {
    "": "set({name}_FOUND TRUE)\nset({name}_INCLUDE_DIRS {stub})\n",
    "pluginlib": """macro(pluginlib_export_plugin_description_file base file)
  install(FILES ${{file}} DESTINATION share/${{PROJECT_NAME}})
  ament_index_register_resource(${{base}}__pluginlib__plugin CONTENT "share/${{PROJECT_NAME}}/${{file}}\\n")
endmacro()
""",
    "generate_parameter_library": """function(generate_parameter_library target file)
  if(NOT EXISTS ${{CMAKE_CURRENT_SOURCE_DIR}}/${{file}})
    message(FATAL_ERROR "${{file}} is not there")
  endif()
  add_library(${{target}} INTERFACE)
  target_include_directories(${{target}} INTERFACE {stub})
endfunction()
""",
}


def by_cmake(folder, package):
    """Build and install a package by its own CMakeLists.txt, with Debian's ament_cmake; where it was installed.

    The packages of ROS 2 that it needs are files of CMake that find the headers which stand for them.
    """
    for name in NEEDS:
        place = folder / "ros" / "share" / name / "cmake"
        place.mkdir(parents=True)
        text = FOUND[""] + FOUND.get(name, "")
        (place / f"{name}Config.cmake").write_text(text.format(name=name, stub=package / "stub"))
    build, install = folder / "build", folder / "install"
    options = {"PREFIX_PATH": folder / "ros", "INSTALL_PREFIX": install, "C_FLAGS": "-Werror", "CXX_FLAGS": "-Werror"}
    flags = [f"-DCMAKE_{key}={value}" for key, value in options.items()] + ["-DPython3_EXECUTABLE=/usr/bin/python3"]
    for command in (["-S", package, "-B", build, *flags], ["--build", build], ["--install", build]):
        done = subprocess.run(["cmake", *command], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return install


def build(folder, name, compiler="gcc", lyrical=False):
    """A shared library of the package and the server."""
    cc, cxx = COMPILERS[compiler]
    common = ["-O1", "-fPIC", *WARNINGS, *(f"-I{folder / part}" for part in ("include", "src", "law", "stub"))]
    made, law = folder / f"{compiler}.so", folder / f"{compiler}.o"
    sources = [folder / "src" / f"{file}.cpp" for file in ("controller", "plan", "spline")] + [DATA / "server.cpp"]
    macros = [f"-DPACKAGE={name}_nav2", *["-DSTANDS_FOR_LYRICAL"] * lyrical]
    for command in (
        [cc, "-std=c99", *common, "-c", folder / "law" / f"{name}.c", "-o", law],
        [cxx, "-std=c++17", "-shared", *common, *macros, *sources, law, "-o", made],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return made


class Server:
    """The library's calls, for numbers of Python."""

    def __init__(self, library):
        self.library = ctypes.CDLL(os.fspath(library))
        for call in ("configure", "plan", "command", "set", "said", "laid"):
            getattr(self.library, call).restype = ctypes.c_char_p

    def configure(self, frequency=20.0, **launched):
        """Why not, or nothing."""
        values = (ctypes.c_double * max(len(launched), 1))(*launched.values())
        return self.library.configure(ctypes.c_double(frequency), " ".join(launched).encode(), values).decode()

    def plan(self, poses, frame="odom"):
        """Poses (n, 3), or (n, 2) that look along x."""
        poses = np.asarray(poses, float).reshape(-1, np.shape(poses)[-1] if np.size(poses) else 3)
        full = np.ascontiguousarray(np.column_stack([poses, np.zeros((len(poses), 3 - poses.shape[1]))]))
        return self.library.plan(ctypes.c_void_p(full.ctypes.data), len(full), frame.encode()).decode()

    def laid(self, poses, spacing, reversing, pace):
        """Tables of a plan by the names that a route has in C, and why there are none."""
        poses, pace = np.ascontiguousarray(poses, float), np.ascontiguousarray(pace, float)
        sizes, length = np.zeros(2, np.int32), np.zeros(1)
        room = [np.zeros(rows * 2**17) for rows in (12, 2, 5)]
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (poses, pace, sizes, length, *room)]
        more = len(poses), ctypes.c_double(spacing), int(reversing)
        told = self.library.laid(pointers[0], *more, *pointers[1:]).decode()
        columns, found = (sizes[0], sizes[0], sizes[1]), {"length": length[0]}
        for name, rows, n, x in zip(
            ("coefficients", "squared_speeds", "each_leg"), (12, 2, 5), columns, room, strict=True
        ):
            found[name] = x[: rows * n].reshape(rows, n)
        return found, told

    def command(self, x, y, heading, speed, yaw_rate, age=0.0, period=0.05):
        """What is sent, and why it is nothing."""
        seen, sent = (ctypes.c_double * 6)(x, y, heading, speed, yaw_rate, age), (ctypes.c_double * 2)()
        told = self.library.command(seen, ctypes.c_double(period), sent).decode()
        return sent[0], sent[1], told

    def set(self, name, value):
        """Why a parameter is not set."""
        return self.library.set(name.encode(), ctypes.c_double(value)).decode()

    def frames(self, x, y, turn):
        """Where odom lies in the map."""
        self.library.frames(*map(ctypes.c_double, (x, y, turn)))

    def tolerate(self, tolerance):
        """Of the goal checker [m]."""
        self.library.tolerate(ctypes.c_double(tolerance))

    def speed_limit(self, limit, percentage=False):
        """As from a costmap filter."""
        self.library.speed_limit(ctypes.c_double(limit), int(percentage))

    def said(self):
        """All of the log."""
        return self.library.said().decode()
