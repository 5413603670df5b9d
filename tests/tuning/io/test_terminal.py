"""Reports as a terminal shows them."""

from tuning.io.terminal import plain


def test_columns_of_a_table_line_up_numbers_to_the_right():
    text = "| gain | before | note |\n|---|---|---|\n| k1 | 20 | **0.75** |\n| omega_n | 3.5 | at `bound` |"
    assert plain(text) == "gain     before  note\nk1           20  0.75\nomega_n     3.5  at bound"


def test_marks_and_pictures_go_and_products_stay():
    text = "# Title\n\n**Not tuned**: a*b*c and 2 * x.\n\n![alt](a.png)\n\n\nrmse_late_x, *said*"
    assert plain(text) == "Title\n\nNot tuned: a*b*c and 2 * x.\n\nrmse_late_x, said"


def test_a_bar_in_a_name_is_no_column():
    assert plain("| a\\|b | c |\n|---|---|\n| 1 | 2 |") == "a|b  c\n  1  2"


def test_long_lines_are_wrapped_lists_with_an_indent_names_kept_whole():
    lines = plain("* " + "word " * 30 + "a-very-long-name.toml", width=40).splitlines()
    assert all(len(line) <= 40 for line in lines) and all(line.startswith("  ") for line in lines[1:])
    assert lines[-1].split()[-1] == "a-very-long-name.toml"
