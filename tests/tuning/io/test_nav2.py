"""Parameter files of Nav2: what they say, and that nothing of them changes but the values that were tuned.

The files in tests/data/nav2 are ours, in the shapes that public ones have. What a text means is asked of PyYAML.
"""

import difflib
import json
import random

import numpy as np
import pytest
import yaml

from agvjax import InputError
from commands import ROOT
from tuning.io import nav2
from tuning.io.nav2.names import DOUBLES, IGNORED, PARAMETERS

DATA = ROOT / "tests" / "data" / "nav2"
RPP = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
SECTIONS = [  # file, controller, where PyYAML finds it
    ("courier", "controller_server.FollowPath", "controller_server/ros__parameters/FollowPath/"),
    ("yard", "/**.Mow", "/**/ros__parameters/Mow."),
    ("fleet", "/robot1/controller_server.FollowPath", "/robot1/controller_server/ros__parameters/FollowPath/"),
    ("fleet", "/robot1/controller_server.Slow", "/robot1/controller_server/ros__parameters/Slow/"),
    ("fleet", "robot2/controller_server.FollowPath", "robot2/controller_server/ros__parameters/FollowPath/"),
    ("fleet", "robot2/controller_server.Spare", "robot2/controller_server/ros__parameters/Spare/"),
    ("anchors", "controller_server.Hall", "controller_server/ros__parameters/Hall/"),
    ("shim", "controller_server.FollowPath", "controller_server/ros__parameters/FollowPath/"),
    (
        "shim",
        "controller_server.Nested.primary_controller",
        "controller_server/ros__parameters/Nested/primary_controller/",
    ),
]
each_section = pytest.mark.parametrize(("name", "controller", "place"), SECTIONS, ids=lambda x: x)


def path(name):
    return DATA / f"{name}.yaml"


def flat(text):
    """Every value of a text by the keys that lead to it, as PyYAML reads it."""

    def parts(data, at):
        if isinstance(data, (dict, list)):
            for key, value in data.items() if isinstance(data, dict) else enumerate(data):
                yield from parts(value, f"{at}{key}/")
        else:
            yield at[:-1], data

    return dict(parts(yaml.safe_load(text), ""))


def one(tmp_path, lines, name="params.yaml", head=""):
    """A file with one section of the lines."""
    file = tmp_path / name
    body = "".join(f"      {line}\n" for line in (f'plugin: "{RPP}"', *lines))
    file.write_text(f"{head}controller_server:\n  ros__parameters:\n    FollowPath:\n{body}")
    return file


def faults(call, *args):
    with pytest.raises(InputError) as caught:
        call(*args)
    return [str(fault) for fault in caught.value.faults]


def test_a_file_as_most_are():
    found = nav2.read(path("courier"))
    assert found.controller == "controller_server.FollowPath"
    assert found.period == 0.04
    assert len(found.values) == 16
    assert set(PARAMETERS) - set(found.values) == {"use_fixed_curvature_lookahead", "curvature_lookahead_dist"}
    assert found.values["desired_linear_vel"] == 0.8
    assert found.values["min_lookahead_dist"] == 0.3
    assert found.values["min_approach_linear_velocity"] == 0.05  # 5e-2, a number to ROS
    assert found.values["use_rotate_to_heading"] is True
    assert found.unknown == ("lookahead_distance",)
    assert set(found.ignored) == {
        *("transform_tolerance", "use_collision_detection", "max_allowed_time_to_collision_up_to_carrot"),
        *("use_cost_regulated_linear_velocity_scaling", "max_robot_pose_search_dist"),
    }
    assert not found.remarks
    lines = path("courier").read_text().splitlines()
    for name, line in found.lines.items():
        assert lines[line - 1].strip().startswith(f"{name}:")


def test_keys_with_dots_of_every_node():
    found = nav2.read(path("yard"))
    assert found.values == {
        **{"desired_linear_vel": 0.45, "lookahead_dist": 1.0},
        **{"use_rotate_to_heading": False, "allow_reversing": True},
    }
    assert found.period == 0.1
    assert found.lines["lookahead_dist"] == 14


def test_without_a_frequency_it_is_that_of_nav2():
    found = nav2.read(path("fleet"), "robot2/controller_server.FollowPath")
    assert found.period == 0.05
    assert "controller_frequency" not in found.lines


def test_a_controller_that_is_not_loaded_is_told_of():
    assert nav2.read(path("fleet"), "Spare").remarks == (
        "controller_plugins names FollowPath: the server will not load Spare.",
    )


def test_anchors_and_merged_tables_are_followed():
    hall = nav2.read(path("anchors"), "Hall")
    assert hall.values == {
        **{"lookahead_dist": 0.6, "lookahead_time": 1.5},
        **{"desired_linear_vel": 0.7, "max_angular_accel": 2.5},
    }
    assert nav2.read(path("anchors"), "Mirror").values == {"curvature_lookahead_dist": 0.5}


def test_a_rotation_shim_around_it():
    found = nav2.read(path("shim"), "controller_server.FollowPath")
    assert found.values["max_angular_accel"] == 3.2
    assert set(found.ignored) == {"angular_dist_threshold", "forward_sampling_distance"}
    assert len(found.remarks) == 1
    nested = nav2.read(path("shim"), "Nested.primary_controller")
    assert nested.values == {"desired_linear_vel": 0.5}  # max_linear_vel
    assert set(nested.ignored) == {"use_dynamic_window", "max_angular_vel"}
    assert len(nested.remarks) == 2


def test_both_names_of_the_speed(tmp_path):
    file = one(tmp_path, ["max_linear_vel: 2.0", "desired_linear_vel: 0.4"])
    found = nav2.read(file)
    assert found.values == {"desired_linear_vel": 0.4}
    assert set(found.ignored) == {"max_linear_vel"}
    assert flat(nav2.write(found.text, {"desired_linear_vel": 0.5})) == flat(found.text.replace("0.4", "0.5"))


def test_several_and_none_asked_for():
    (said,) = faults(nav2.read, path("fleet"))
    for name in (
        "/robot1/controller_server.FollowPath",
        "/robot1/controller_server.Slow",
        "robot2/controller_server.Spare",
    ):
        assert name in said
    assert "in full" in faults(nav2.read, path("fleet"), "FollowPath")[0]
    assert "Dwb" not in faults(nav2.read, path("fleet"), "Dwb")[0].split("must be")[1]
    assert nav2.read(path("fleet"), "Slow").values["lookahead_dist"] == 0.4


def tuned_values(seed):
    draw = random.Random(seed)
    drawn = {
        name: draw.random() < 0.5 if isinstance(parameter.default, bool) else draw.uniform(0.3, 3.0)
        for name, parameter in PARAMETERS.items()
    }
    ends = sorted(drawn[name] for name in ("min_lookahead_dist", "max_lookahead_dist"))
    return drawn | dict(zip(("min_lookahead_dist", "max_lookahead_dist"), ends, strict=True))


@each_section
@pytest.mark.parametrize("ends", ["\n", "\r\n"], ids=["unix", "dos"])
@pytest.mark.parametrize("mark", ["", "\ufeff"], ids=["", "bom"])
def test_what_is_written_is_read_and_nothing_else_changes(name, controller, place, ends, mark, tmp_path):
    before = mark + path(name).read_text().replace("\n", ends)
    tuned = tuned_values(f"{name} {controller}")
    after = nav2.write(before, tuned, controller)
    (tmp_path / "after.yaml").write_bytes(after.encode())
    found = nav2.read(tmp_path / "after.yaml", controller)
    assert set(found.values) == set(PARAMETERS)
    for key, value in tuned.items():
        assert found.values[key] == pytest.approx(value, rel=5e-6)
        assert isinstance(found.values[key], type(value))
    old, new = flat(before), flat(after)
    changed = {key for key in {*old, *new} if old.get(key) != new.get(key)}
    names = {*PARAMETERS, "max_linear_vel"}
    assert all(key.startswith(place) and key.removeprefix(place) in names for key in changed)
    assert all(type(new[key]) in (float, bool) for key in changed)  # to PyYAML too, which Nav2's launch files use
    assert after.count("\n") == after.count(ends)


@each_section
def test_all_but_the_values_stays_to_the_letter(name, controller, place):
    """Take away from the new text what the tuned values and new lines are: the old text without its values is left."""
    before = path(name).read_text()
    present = nav2.read(path(name), controller).values
    after = nav2.write(before, {key: tuned_values(3)[key] for key in present}, controller)
    pieces = difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes()
    for tag, a, b, c, d in pieces:
        if tag != "equal":
            assert "\n" not in before[a:b]
            assert "#" not in before[a:b] + after[c:d]
    merged = [line for line in after.splitlines() if line not in before.splitlines()]
    assert len(merged) <= len(present)


@each_section
def test_what_stands_there_is_left_as_it_stands(name, controller, place):
    found = nav2.read(path(name), controller)
    assert nav2.write(found.text, found.values, controller) == found.text
    assert nav2.diff(found.text, found.text) == ""
    assert nav2.write(found.text, {}, controller) == found.text


def test_digits_and_spelling():
    text = path("courier").read_text()
    tuned = {
        "desired_linear_vel": 1,
        "lookahead_dist": 0.123456789,
        "lookahead_time": 1e-5,
        "max_angular_accel": 1234.56789,
    }
    tuned |= {"use_rotate_to_heading": np.False_, "allow_reversing": True, "min_lookahead_dist": np.float32(0.1)}
    after = nav2.write(text, tuned)
    for line in (
        "      desired_linear_vel: 1.0            # as fast as the nurses allow\n",
        "      lookahead_dist: 0.123457                 # without use_velocity_scaled_lookahead_dist\n",
        "      min_lookahead_dist:  0.1\n",
        "      lookahead_time: 0.00001\n",
        "      max_angular_accel: 1234.57\n",
        "      use_rotate_to_heading: False\n",  # a capital letter where there was one
        "      allow_reversing: True\n",
    ):
        assert line in after


def test_a_parameter_that_is_not_there_gets_a_line_below_the_plugin():
    text = path("courier").read_text()
    after = nav2.write(text, {"curvature_lookahead_dist": 0.7, "use_fixed_curvature_lookahead": True})
    added = "      use_fixed_curvature_lookahead: true\n      curvature_lookahead_dist: 0.7\n"
    head, tail = text.split('RegulatedPurePursuitController"\n')
    assert after == head + 'RegulatedPurePursuitController"\n' + added + tail


def test_in_braces_and_with_dots_too():
    text = path("fleet").read_text()
    after = nav2.write(text, {"lookahead_time": 1.25}, "robot2/controller_server.FollowPath")
    assert after == text.replace('Controller",\n', 'Controller", lookahead_time: 1.25,\n')
    text = path("yard").read_text()
    after = nav2.write(text, {"lookahead_time": 1.25})
    assert after == text.replace(RPP + "\n", RPP + "\n    Mow.lookahead_time: 1.25\n")


def test_a_last_line_without_an_end(tmp_path):
    text = one(tmp_path, []).read_text().rstrip("\n")
    after = nav2.write(text, {"lookahead_dist": 0.5})
    assert after == text + "\n      lookahead_dist: 0.5"
    assert nav2.diff(text, after).count("\\ No newline at end of file\n") == 2


def test_a_merged_value_becomes_the_controllers_own():
    text = path("anchors").read_text()
    after = nav2.write(text, {"lookahead_dist": 0.9, "desired_linear_vel": 0.8}, "Hall")
    assert after == text.replace(
        "      <<: *pursuit\n      desired_linear_vel: *speed\n",
        "      lookahead_dist: 0.9\n      <<: *pursuit\n      desired_linear_vel: 0.8\n",
    )


def test_a_value_that_others_have_is_not_written():
    text = path("anchors").read_text()
    (said,) = faults(nav2.write, text, {"regulated_linear_scaling_min_speed": 0.2}, "Ramp")
    assert "docking_server.ros__parameters.gate.min_approach_linear_velocity" in said
    assert "line 20" in said
    assert "Mirror.curvature_lookahead_dist" in faults(nav2.write, text, {"lookahead_dist": 0.4}, "Gate")[0]
    assert "docking_server" in faults(nav2.write, text, {"lookahead_time": 1.0}, "Gate")[0]  # a table of two
    after = nav2.write(text, {"curvature_lookahead_dist": 0.4}, "Mirror")  # the alias, not its anchor
    assert after == text.replace("curvature_lookahead_dist: *far", "curvature_lookahead_dist: 0.4")
    after = nav2.write(text, {"desired_linear_vel": 0.4}, "Ramp")
    assert after == text.replace("desired_linear_vel: *slow", "desired_linear_vel: 0.4")


def test_what_only_holds_an_anchor_is_nobodys(tmp_path):
    text = f"held: &held {{plugin: {RPP}, lookahead_dist: 0.6}}\nserver:\n  ros__parameters:\n    Hall: *held\n"
    after = nav2.write(text, {"lookahead_dist": 0.5, "lookahead_time": 1.0})
    assert after == text.replace("lookahead_dist: 0.6", "lookahead_time: 1.0, lookahead_dist: 0.5")
    text += "    Ramp: *held\n"
    assert len(faults(nav2.write, text, {"lookahead_dist": 0.5, "lookahead_time": 1.0}, "Hall")) == 2


def test_json_stays_json():
    parameters = {"FollowPath": {"plugin": RPP, "lookahead_dist": 0.6}}
    text = json.dumps({"controller_server": {"ros__parameters": parameters}})
    after = nav2.write(text, {"lookahead_time": 1.25})
    assert json.loads(after)["controller_server"]["ros__parameters"]["FollowPath"]["lookahead_time"] == 1.25


def test_a_form_that_cannot_be_written_is_refused():
    head = "controller_server:\n  ros__parameters:\n    FollowPath:\n"
    text = f"{head}      ? plugin\n      : {RPP}\n      ? lookahead_dist\n      : 0.6\n"
    assert "by hand" in faults(nav2.write, text, {"lookahead_time": 1.25})[0]
    assert nav2.write(text, {"lookahead_dist": 0.5}) == text.replace("0.6", "0.5")


@pytest.mark.parametrize("value", ["[0.6]", "{a: 0.6}", "\n        a: 0.6"])
def test_a_list_or_a_table_is_no_value(value, tmp_path):
    file = one(tmp_path, [f"lookahead_dist: {value}"])
    said = "controller_server.FollowPath.lookahead_dist = a list or table: must be a single value"
    assert faults(nav2.read, file)[0].startswith(said)
    assert faults(nav2.write, file.read_text(), {"lookahead_dist": 0.5})[0].startswith(said)


def test_an_anchor_that_nobody_uses_is_kept(tmp_path):
    text = one(tmp_path, ["lookahead_dist: &mine !!float 0.6  # mine"]).read_text()
    assert nav2.write(text, {"lookahead_dist": 0.5}) == text.replace("0.6", "0.5")


def test_the_difference_for_a_report():
    text = path("courier").read_text()
    said = nav2.diff(text, nav2.write(text, {"lookahead_time": 1.2}), "courier.yaml").splitlines()
    assert said[:2] == ["--- a/courier.yaml", "+++ b/courier.yaml"]
    assert [line for line in said[2:] if line[0] in "+-"] == [
        "-      lookahead_time: 1.5",
        "+      lookahead_time: 1.2",
    ]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("lookahead_dist: 1", "lookahead_dist = 1: must be a double, 1.0: Nav2 refuses a whole number when it starts"),
        ("cost_scaling_dist: 1", "cost_scaling_dist = 1: must be a double"),
        ("lookahead_dist: '0.6'", "lookahead_dist = 0.6: must be a number with a point, not in quotes"),
        ("lookahead_dist: true", "lookahead_dist = true: must be a number"),
        ("lookahead_dist:", "lookahead_dist = : must be a number"),
        ("lookahead_dist: 1_0.5", "lookahead_dist = 1_0.5: must be a number"),
        ("lookahead_dist: 1:30.5", "lookahead_dist = 1:30.5: must be a number"),
        ("lookahead_dist: .nan", "lookahead_dist = nan: must be finite"),
        ("lookahead_dist: -.inf", "lookahead_dist = -inf: must be finite"),
        ("lookahead_dist: -0.5", "lookahead_dist = -0.5: must be > 0 m"),
        ("max_linear_vel: -0.5", "max_linear_vel = -0.5: must be > 0 m/s"),
        ("min_approach_linear_velocity: -0.1", "min_approach_linear_velocity = -0.1: must be >= 0 m/s"),
        ("use_rotate_to_heading: 1", "use_rotate_to_heading = 1: must be true or false"),
        ("use_rotate_to_heading: 'true'", "use_rotate_to_heading = true: must be true or false, not in quotes"),
    ],
)
def test_a_value_that_nav2_or_the_law_refuses(line, said, tmp_path):
    file = one(tmp_path, [line])
    (fault,) = faults(nav2.read, file)
    assert fault.startswith(f"controller_server.FollowPath.{said}")
    assert fault.endswith(f"[{file}, line 5]")


def test_every_fault_is_told_and_told_once(tmp_path):
    file = one(tmp_path, ["lookahead_dist: 1", "lookahead_time: -1.0", "lookahead_dist: 2"])
    file.write_text(file.read_text().replace("    FollowPath:", "    controller_frequency: 20\n    FollowPath:"))
    said = faults(nav2.read, file)
    assert [line.split(" =")[0].rpartition(".")[2] for line in said] == [
        *("lookahead_dist", "lookahead_dist", "lookahead_time", "controller_frequency"),
    ]
    assert "named once; line 6 says 1" in said[0]
    file = one(tmp_path, ["use_velocity_scaled_lookahead_dist: true", "min_lookahead_dist: 1.0"])
    assert "at most max_lookahead_dist, 0.9" in faults(nav2.read, file)[0]


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "a: [1",
            "\ta: 1",
            "a: 1\n---\nb: 2\n",
            "a: &a [*a]\n",
            "a: \x07",
            "[" * 5000,
            "- 1\n- 2\n",
            "a: *b",
            "text",
        ),
        *(
            "controller_server:\n  FollowPath:\n    plugin: " + RPP,
            "<<: 3\nb: 1\n",
            "? [a]\n: 1\n",
            "a: &a\n  <<: *a\n",
        ),
        "a: &a [1,1,1,1,1,1,1,1,1]\n"
        + "".join(f"{chr(98 + i)}: &{chr(98 + i)} [{','.join(9 * ['*' + chr(97 + i)])}]\n" for i in range(9)),
    ],
)
def test_a_file_that_is_none(text, tmp_path):
    file = tmp_path / "none.yaml"
    file.write_text(text)
    (said,) = faults(nav2.read, file)
    assert str(file) in said
    faults(nav2.write, text, {"lookahead_dist": 1.0})


def test_a_file_that_cannot_be_read(tmp_path):
    assert "No such file" in faults(nav2.read, tmp_path / "nowhere.yaml")[0]
    assert "folder" in faults(nav2.read, tmp_path)[0]
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    assert "UTF-8" in faults(nav2.read, tmp_path / "bytes")[0]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lookahead", 1.0),
        ("lookahead_dist", np.nan),
        ("lookahead_dist", -1.0),
        ("lookahead_dist", True),
        ("allow_reversing", 1.0),
    ],
)
def test_a_value_that_cannot_be_written(name, value):
    text = path("courier").read_text()
    assert faults(nav2.write, text, {name: value, "lookahead_time": np.inf})[0].startswith(f"{name} = ")


def test_no_name_is_both_of_the_law_and_ignored():
    assert not set(PARAMETERS) & set(IGNORED)
    assert set(IGNORED) >= DOUBLES


def test_a_least_look_ahead_above_the_largest_is_not_written():
    text = path("courier").read_text()
    with pytest.raises(InputError, match="min_lookahead_dist = 2"):
        nav2.write(
            text, {"min_lookahead_dist": 2.0, "max_lookahead_dist": 1.0, "use_velocity_scaled_lookahead_dist": True}
        )
