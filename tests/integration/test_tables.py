"""How the command line lays out its tables."""

from debrisgrasp.cli.tables import columns


def test_long_words_at_the_end_of_a_row_do_not_draw_a_long_rule():
    rows = [["1", "nothing bears on it; way out free upwards; 0.76 m away"]]
    assert columns(["turn", "because"], rows).splitlines()[1] == "----  -------"
    assert columns(["what", ""], [["python", "3.11"]]).splitlines()[1] == "------  ----"


def test_numbers_are_ruled_as_far_as_they_go():
    text = columns(["part", "n"], [["ground", "217181"], ["wall", "12"]])
    assert text.splitlines() == [
        "part         n",
        "------  ------",
        "ground  217181",
        "wall        12",
    ]
