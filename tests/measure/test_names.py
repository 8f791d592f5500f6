"""What users measure with is listed, documented, and found where `jaxspatial` is."""

import jaxspatial as js


def test_public_names_are_documented():
    names = {name for name in vars(js.measure) if not name.startswith("_")}
    assert {"evaluate", "in_ulps", "inputs", "interleaved", "machine", "recommend", "self_check", "Report"} <= names
    for name in names:
        assert getattr(js.measure, name).__doc__, name


def test_the_self_check_is_that_of_the_top():
    assert callable(js.measure.recommend) and js.measure.self_check is js.self_check
