"""Whatever is written in a scenario, it is either valid or refused in one line that names the key."""

import string

from hypothesis import given, settings
from hypothesis import strategies as st

from hil_sim import scenario
from hil_sim.errors import ScenarioError

fixed = settings(derandomize=True, deadline=None, max_examples=200)
words = st.text(string.ascii_lowercase + "_", min_size=1, max_size=20)
sections = st.sampled_from(
    ["time", "orbit", "truth", "gnss", "outage.0", "oscillator", "flight", "fault.0", "burn.0", "command.0", "attitude"]
)
values = st.one_of(
    st.integers().map(str),
    st.floats().map(str),
    st.booleans().map(lambda b: str(b).lower()),
    words,
    st.just("[]"),
    st.just("{}"),
    st.just("[{a = 1}]"),
    st.text(max_size=20),
)
EVERY_SECTION = [
    *("fault.0.kind=nan", "fault.0.start_s=1", "attitude.sigma_rad=0.1"),
    "burn=[{start_s=100.0, duration_s=10.0, dv_mps=[0.0, 1.0, 0.0]}]",
    'command=[{at_s=10.0, command="edit", target="velocity", value="reject"}]',
]
known_keys = st.sampled_from(
    [key for key in scenario.load("paper_outage", EVERY_SECTION).origin if not key.startswith("flight.table.")]
)


def outcome(*overrides: str) -> scenario.LoadedScenario | str:
    """The scenario, or the text of its refusal; anything but ScenarioError fails the test."""
    try:
        return scenario.load("paper_outage", overrides)
    except ScenarioError as error:
        return str(error)


@fixed
@given(sections, words, values)
def test_unknown_keys_never_pass(section: str, word: str, value: str) -> None:
    result = outcome(f"{section}.{word}={value}")
    if isinstance(result, str):
        assert "\n" not in result
        assert section.split(".")[0] in result
    else:
        assert f"{section}.{word}" in result.origin or word == "table"


@fixed
@given(known_keys, values)
def test_known_keys_take_valid_values_only(key: str, value: str) -> None:
    result = outcome(*EVERY_SECTION, f"{key}={value}")
    if isinstance(result, str):
        assert "\n" not in result
        assert result.startswith(("--set", str(scenario.SCENARIO_FOLDER)))
    else:
        assert scenario.describe(result)
