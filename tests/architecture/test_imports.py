"""Who may import whom (docs/architecture.md). Each rule is shown to catch a breach of it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import pytest
from source_tree import GENERATED, Source, find_cycle, graph, is_within, reachable, sources

STANDARD = frozenset(sys.stdlib_module_names)
Judge = Callable[[str], bool]


def none_of(*modules: str) -> Judge:
    """Permits every import but these modules and what is in them."""
    return lambda name: not any(is_within(name, module) for module in modules)


def of_ours_only(*modules: str) -> Judge:
    """Permits any third party, but of the three packages only these modules."""

    def judge(name: str) -> bool:
        ours = name.partition(".")[0] in ("flightsw", "ground", "hil_sim")
        return not ours or any(is_within(name, module) for module in modules)

    return judge


def only(*modules: str) -> Judge:
    """Permits these modules and what is in them, nothing else."""
    return lambda name: any(is_within(name, module) for module in modules)


def standard_library_and(*modules: str) -> Judge:
    """Permits the standard library and these modules."""
    return lambda name: name.partition(".")[0] in STANDARD or any(is_within(name, module) for module in modules)


@dataclass(frozen=True)
class Rule:
    """Which imports the files under some paths may have. A path ending in `/` is a folder."""

    name: str
    paths: tuple[str, ...]
    permits: Judge
    breach: tuple[str, str]  # a file and a line in it that the rule must catch
    excepted: dict[str, str] = field(default_factory=dict)  # path -> reason

    def covers(self, path: str) -> bool:
        """Whether a file is bound by the rule."""
        return path not in self.excepted and any(
            path == p or (p.endswith("/") and path.startswith(p)) for p in self.paths
        )

    def breaches(self, files: Iterable[Source]) -> list[str]:
        """`file:line imports module` for every import that is not permitted."""
        return [
            f"{source.path}:{line} imports {name}"
            for source in files
            if self.covers(source.path)
            for line, name in source.imports()
            if not self.permits(name)
        ]


_GENERATED_DIALECT = {"flightsw/icd/mavlink.py": GENERATED["flightsw/icd/mavlink.py"]}
_COMPILED = (
    "flightsw/kernels/",
    "flightsw/nav/",
    "flightsw/integrity/",
    "flightsw/crosslink/",
    "flightsw/gnss/",
    "flightsw/derivative/",
    "flightsw/records.py",
    "flightsw/modes.py",
)

RULES = (
    Rule(
        "flight knows neither the ground nor the simulated world, parses no text and logs none",
        ("flightsw/",),
        none_of("ground", "hil_sim", "cantools", "tomllib", "logging"),
        ("flightsw/main_loop.py", "import logging"),
        _GENERATED_DIALECT,
    ),
    Rule(
        "flight starts no helper threads or processes: a busy one costs milliseconds of a tick",
        ("flightsw/",),
        none_of("threading", "multiprocessing", "concurrent", "asyncio", "subprocess"),
        ("flightsw/journal.py", "from threading import Thread"),
    ),
    Rule(
        "flight speaks MAVLink by its own dialect, never by pymavlink's own modules",
        ("flightsw/",),
        none_of("pymavlink"),
        ("flightsw/link/mavlink_out.py", "from pymavlink import mavutil"),
    ),
    Rule(
        "the contract needs the standard library and numpy only",
        ("flightsw/icd/",),
        standard_library_and("numpy", "flightsw.icd"),
        ("flightsw/icd/table_file.py", "from flightsw.records import TABLE"),
        _GENERATED_DIALECT,
    ),
    Rule(
        "compiled rooms need numpy, numba, math and each other; of the contract its constants",
        _COMPILED,
        only(
            "numpy",
            "numba",
            "math",
            "typing",
            "collections.abc",
            "__future__",
            "flightsw.kernels",
            "flightsw.nav",
            "flightsw.integrity",
            "flightsw.crosslink",
            "flightsw.gnss",
            "flightsw.derivative",
            "flightsw.rooms",
            "enum",
            "flightsw.records",
            "flightsw.modes",
            "flightsw.icd.enums",
            "flightsw.icd.alerts",
            "flightsw.icd.table_schema",
        ),
        ("flightsw/nav/step.py", "from flightsw.journal import Journal"),
        {
            "flightsw/kernels/kernel_cache.py": "finds and names the cache folder before numba is imported",
            "flightsw/kernels/cache_locator.py": "names the place of a file in that folder, for numba",
            "flightsw/crosslink/assembly.py": "reads frames as they lie on the bus: their layouts",
            "flightsw/crosslink/declare.py": "hashes the sources of its room for numba's cache",
            "flightsw/crosslink/setup.py": "settings of a monitor, before any tick",
            "flightsw/gnss/declare.py": "hashes the sources of its room for numba's cache",
            "flightsw/gnss/setup.py": "settings of a test, before any tick",
            "flightsw/derivative/declare.py": "hashes the sources of its room for numba's cache",
            "flightsw/derivative/setup.py": "settings of the estimators, before any tick",
        },
    ),
    Rule(
        "the kernels are domain-free: they know no navigation, bound or mode",
        ("flightsw/kernels/",),
        none_of(
            "flightsw.nav",
            "flightsw.integrity",
            "flightsw.crosslink",
            "flightsw.gnss",
            "flightsw.derivative",
            "flightsw.modes",
        ),
        ("flightsw/kernels/linalg.py", "from flightsw.nav import filter"),
    ),
    Rule(
        "the world knows of flight the contract only, so that it can prove something about the rest",
        ("hil_sim/",),
        of_ours_only("hil_sim", "flightsw.icd"),
        ("hil_sim/truth/propagated.py", "from flightsw.kernels import gravity"),
        {
            "hil_sim/sil.py": "composition root of a whole run",
            "hil_sim/soak.py": "composition root of a flight lap after lap",
            "hil_sim/soak_report.py": "reads the accounts of the loop that the soak has composed",
        },
    ),
    Rule(
        "only the command calls the composition root of a run",
        ("hil_sim/",),
        none_of("hil_sim.sil"),
        ("hil_sim/world.py", "from hil_sim import sil"),
        {
            "hil_sim/soak.py": "the same tables, from the command",
            "hil_sim/__main__.py": "the command",
            "hil_sim/demo.py": "the same run as live processes, from the command",
        },
    ),
    Rule(
        "console, tables and interface know of flight the contract only",
        ("ground/console/", "ground/tables/", "ground/icdgen/", "ground/__main__.py", "ground/errors.py"),
        of_ours_only(
            "ground.console",
            "ground.tables",
            "ground.icdgen",
            "ground.errors",
            "ground.workers",
            "ground.__main__",
            "flightsw.icd",
        ),
        ("ground/console/view.py", "from flightsw.kernels.registry import warm_up"),
    ),
    Rule(
        "the ground takes of the world its truth at most",
        ("ground/",),
        of_ours_only("ground", "flightsw", "hil_sim.truth"),
        ("ground/reports/figures.py", "from hil_sim.world import World"),
        {
            "ground/campaign/flown.py": "composes world and flight as sil.py does, through the compiled arc",
            "ground/timing/link_work.py": "composes world, flight and ground station, as sil.py does, to time the link",
            "ground/studies/flights.py": "loads, flies and evaluates scenarios as a run does, for the studies",
        },
    ),
)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_every_import_is_permitted(rule: Rule) -> None:
    """GIVEN all sources WHEN a rule judges them THEN it finds no breach."""
    assert rule.breaches(sources()) == []


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_the_rule_can_fail(rule: Rule) -> None:
    """GIVEN a file with one forbidden line WHEN the rule judges it THEN it names file and line."""
    path, line = rule.breach
    (found,) = rule.breaches([Source(path, f"'''A file.'''\n{line}\n")])
    assert found.startswith(f"{path}:2 ")


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_the_rule_covers_something_and_every_exception_is_needed(rule: Rule) -> None:
    """GIVEN a rule WHEN its paths and exceptions are looked up THEN each stands for a file that exists and needs it."""
    paths = {source.path for source in sources()}
    for path in rule.paths:
        assert any(p == path or p.startswith(path) for p in paths), f"{path}: no such file or folder"
    for path, reason in rule.excepted.items():
        assert reason
        (source,) = [source for source in sources() if source.path == path]
        assert not all(rule.permits(name) for _, name in source.imports()), f"{path} needs no exception any more"


def test_a_late_import_and_a_relative_one_are_seen() -> None:
    """GIVEN an import inside a function, and a relative one WHEN imports are listed THEN both are there, resolved."""
    source = Source(
        "flightsw/nav/step.py", "def f():\n    import cantools\nfrom . import chain\nfrom ..icd import enums\n"
    )
    assert sorted(source.imports()) == [
        (2, "cantools"),
        (3, "flightsw.nav.chain"),
        (4, "flightsw.icd.enums"),
    ]


def test_no_circles() -> None:
    """GIVEN the graph of imports, late ones included WHEN it is searched THEN there is no circle in it."""
    assert find_cycle(graph(sources())) == []


def test_a_circle_is_found() -> None:
    """GIVEN three files in a circle, one import in a function WHEN the graph is searched THEN the circle is named."""
    files = (
        Source("ground/a.py", "from ground import b\n"),
        Source("ground/b.py", "def f():\n    from ground.c import thing\n"),
        Source("ground/c.py", "import ground.a\n"),
    )
    assert find_cycle(graph(files)) == ["ground.a", "ground.b", "ground.c", "ground.a"]


def _modules(*prefixes: str) -> list[str]:
    return [source.module for source in sources() if any(is_within(source.module, p) for p in prefixes)]


def _imports_numba(module: str) -> bool:
    return any(is_within(n, "numba") for source in sources() if source.module == module for _, n in source.imports())


@pytest.mark.parametrize("module", _modules("ground.console", "ground.tables", "ground.icdgen", "flightsw.icd"))
def test_numba_is_out_of_reach(module: str) -> None:
    """GIVEN a room that must start at once WHEN its imports are followed to the end THEN numba is not among them."""
    reached = reachable(graph(sources()), module)
    assert [name for name in sorted(reached) if _imports_numba(name)] == []


def test_numba_in_reach_is_seen() -> None:
    """GIVEN the navigation step, which is compiled WHEN its imports are followed THEN numba is found."""
    assert any(_imports_numba(name) for name in reachable(graph(sources()), "flightsw.nav.step"))
