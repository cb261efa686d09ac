from flexslew_plant.errors import BadInput, RunFault


def test_a_message_is_one_line_whatever_it_names() -> None:
    assert str(BadInput("a.yaml: law: 'ü'")) == "a.yaml: law: 'ü'"
    assert str(RunFault("a\nb\x1ec\x00\u2028")) == r"a\nb\x1ec\x00\u2028"
    assert str(BadInput()) == ""
