"""What users measure with is listed, documented, and found where `jaxspatial` is."""

import jaxspatial as js


def test_public_names_are_documented():
    names = {name for name in vars(js.measure) if not name.startswith("_")}
    assert {"error", "exact", "inputs", "timing", "trade", "in_ulps", "recommend", "self_check"} <= names
    for name in names:
        assert getattr(js.measure, name).__doc__, name


def test_a_name_of_the_list_is_not_its_module():
    """`recommend` and `self_check` are functions, in files of the same names."""
    assert callable(js.measure.recommend) and js.measure.self_check is js.self_check
