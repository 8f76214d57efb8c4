"""Rules of single files: roots of composition, length, docstrings, nothing of one machine. Each can fail."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest
from source_tree import GENERATED, ROOT, Source, sources

LONGEST = 400

# Longer than LONGEST, with the reason.
LONG_FILES: dict[str, str] = {}

ENVIRONMENT_ROOTS = {
    "ground/crosslink/command.py": "one thread for products of small matrices, said before numpy is imported",
    "flightsw/kernels/kernel_cache.py": (
        "keys the kernel cache where kernels are declared: a root that forgot to would fly stale machine code "
        "(docs/adr/0001)"
    ),
    "ground/accuracy/command.py": "finds the operator's folder of real orbits (LEONAV_DATA)",
    "hil_sim/scenario.py": "finds the operator's data folder (LEONAV_DATA) and the files a scenario names",
    "hil_sim/truth/satkit_data.py": "satkit takes the folder of its data from the environment only",
    "ground/timing/instructions.py": "lends its own to a flight under valgrind, with the processor to compile for",
    "ground/timing/flights.py": "hands its own to a flight whose kernels are to be compiled anew",
}
SOCKET_ROOTS = {
    "flightsw/onboard.py": "composition root of a flight in real time: the telemetry link the operator named",
    "flightsw/link_open.py": "names of the link that the operator gave, to addresses",
    "flightsw/link_port.py": "the ends of the ground link, made by link_open for the composition root",
    "flightsw/remote_bus.py": "bounds the waits of the bus hub's client",
    "hil_sim/demo.py": "asks for a free port of loopback for the console",
    "hil_sim/hub.py": "the bus hub, on loopback",
    "ground/timing/link_work.py": "a ground station on loopback, for a flight whose link is timed",
    "ground/console/link.py": "the console's end of the link, on loopback unless the operator names another address",
}
BUS_ROOTS = {
    "flightsw/onboard.py": "the bus the operator named",
    "hil_sim/live.py": "the bus of a world in real time, that the operator named",
}
PRINTING_FLIGHT = {
    "flightsw/__main__.py": "the command",
    "flightsw/onboard.py": "progress before the first tick, result after the last",
}


def reads_environment(source: Source) -> Iterator[int]:
    """Lines that read or change the process's environment or look for the user's home."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Attribute) and (
            (isinstance(node.value, ast.Name) and (node.value.id, node.attr) in _OS_NAMES)
            or node.attr in ("expanduser", "home")
        ):
            yield node.lineno
        elif isinstance(node, ast.ImportFrom) and node.module == "os":
            yield from (node.lineno for alias in node.names if ("os", alias.name) in _OS_NAMES)


_OS_NAMES = {("os", name) for name in ("environ", "environb", "getenv", "putenv", "unsetenv")}


def opens_sockets(source: Source) -> Iterator[int]:
    """Lines that import a module whose business is sockets."""
    for line, name in source.imports():
        if name.partition(".")[0] in ("socket", "socketserver", "ssl", "http", "urllib", "requests"):
            yield line


def opens_a_bus(source: Source) -> Iterator[int]:
    """Lines that name python-can's bus as something to make."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("can.Bus", "can.ThreadSafeBus"):
            yield node.lineno
    yield from (line for line, name in source.imports() if name in ("can.Bus", "can.ThreadSafeBus"))


def prints(source: Source) -> Iterator[int]:
    """Lines that print."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
            yield node.lineno


ROOT_RULES = {
    "reads the environment": (reads_environment, ENVIRONMENT_ROOTS, "", "import os\nx = os.environ['HOME']\n"),
    "opens sockets": (opens_sockets, SOCKET_ROOTS, "", "import math\nimport socket\n"),
    "opens a bus": (opens_a_bus, BUS_ROOTS, "", "import can\nbus = can.Bus(interface='virtual')\n"),
    "prints in flight": (prints, PRINTING_FLIGHT, "flightsw/", "x = 1\nprint(x)\n"),
}


@pytest.mark.parametrize("rule", ROOT_RULES)
def test_only_listed_files_do(rule: str) -> None:
    """GIVEN all hand-written sources WHEN a rule looks for what only roots do THEN it finds the listed ones."""
    look, roots, folder, _ = ROOT_RULES[rule]
    found = {
        source.path: list(look(source))
        for source in sources()
        if source.path.startswith(folder) and source.path not in GENERATED and any(look(source))
    }
    unlisted = {path: lines for path, lines in found.items() if path not in roots}
    assert unlisted == {}, f"{rule}, and is not listed as a root with a reason"
    assert set(roots) - set(found) == set(), f"listed as a root that {rule}, and does not"


@pytest.mark.parametrize("rule", ROOT_RULES)
def test_root_rules_can_fail(rule: str) -> None:
    """GIVEN a bad source WHEN the rule looks at it THEN it finds line 2."""
    look, _, _, bad = ROOT_RULES[rule]
    assert list(look(Source("flightsw/bad.py", bad))) == [2]


@pytest.mark.parametrize("text", ["from os import environ\n", "from pathlib import Path\nPath('~').expanduser()\n"])
def test_other_ways_to_the_environment_are_seen(text: str) -> None:
    """GIVEN other ways to read the environment WHEN the rule looks THEN it sees them."""
    assert any(reads_environment(Source("ground/bad.py", text)))


def too_long(path: str, text: str) -> bool:
    """Whether a file is longer than a reader can hold."""
    return path not in GENERATED and path not in LONG_FILES and len(text.splitlines()) > LONGEST


def _python_files() -> list[Path]:
    return [ROOT / source.path for source in sources()] + sorted((ROOT / "tests").rglob("*.py"))


def test_files_are_short() -> None:
    """GIVEN every hand-written Python file WHEN its lines are counted THEN there are at most 400, or a reason."""
    texts = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in _python_files()}
    assert [path for path, text in texts.items() if too_long(path, text)] == []
    assert [path for path in LONG_FILES if len(texts.get(path, "").splitlines()) <= LONGEST] == []


def test_a_long_file_is_seen() -> None:
    """GIVEN a file of 401 lines WHEN it is judged THEN it is too long, unless it is generated."""
    assert too_long("ground/bad.py", "x = 1\n" * (LONGEST + 1))
    assert not too_long("flightsw/icd/mavlink.py", "x = 1\n" * (LONGEST + 1))


Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
_SPOKEN_BY_BASE = ("Protocol", "App", "Screen", "Static", "Widget", "ArgumentParser", "Section", "IntEnum")


def undocumented(source: Source) -> list[str]:
    """Public modules, classes, functions and methods without a docstring.

    A method needs none where a documented method or function of the same name stands in the same file (a Protocol,
    another implementation), nor where it overrides one of a framework's base class; neither does a section of a
    scenario, whose fields carry their own descriptions.
    """
    missing = [] if ast.get_docstring(source.tree) or not source.text.strip() else ["the file"]
    spoken = {node.name for node in ast.walk(source.tree) if isinstance(node, Definition) and ast.get_docstring(node)}

    def visit(body: list[ast.stmt], owner: ast.ClassDef | None) -> None:
        for node in body:
            if not isinstance(node, Definition) or node.name.startswith("_"):
                continue
            bases = {base.attr if isinstance(base, ast.Attribute) else getattr(base, "id", "") for base in _bases(node)}
            inherited = owner is not None and bool(_names(_bases(owner)) & set(_SPOKEN_BY_BASE))
            if not ast.get_docstring(node) and node.name not in spoken and not inherited and "Section" not in bases:
                missing.append(f"{owner.name}.{node.name}" if owner else node.name)
            if isinstance(node, ast.ClassDef):
                visit(node.body, node)

    visit(source.tree.body, None)
    return [f"{source.path}: {name}" for name in missing]


def _bases(node: Definition) -> list[ast.expr]:
    return [base.value if isinstance(base, ast.Subscript) else base for base in getattr(node, "bases", [])]


def _names(bases: list[ast.expr]) -> set[str]:
    return {base.attr if isinstance(base, ast.Attribute) else getattr(base, "id", "") for base in bases}


def test_everything_public_has_a_docstring() -> None:
    """GIVEN all hand-written sources WHEN public names are listed THEN each has a docstring."""
    assert [name for source in sources() if source.path not in GENERATED for name in undocumented(source)] == []


def test_a_missing_docstring_is_seen() -> None:
    """GIVEN a file without docstrings WHEN it is judged THEN every public name in it is named."""
    text = "class A:\n    def f(self): ...\n    def _g(self): ...\ndef h():\n    def inner(): ...\n"
    assert undocumented(Source("ground/bad.py", text)) == [
        "ground/bad.py: the file",
        "ground/bad.py: A",
        "ground/bad.py: A.f",
        "ground/bad.py: h",
    ]


# Put together here so that this file does not itself name what it looks for.
_HOSTS = (
    "py" + "pi.org",
    "python" + "hosted.org",
    "ana" + "conda.org",
    "npm" + "js.",
    "debian" + ".org",
    "index" + "-url",
)
_PLACES = tuple("/" + place + "/" for place in ("ro" + "ot", "wo" + "rk", "o" + "pt", "ho" + "me/[a-z]+"))
OF_ONE_MACHINE = re.compile(
    "|".join([re.escape(host) for host in _HOSTS] + [rf"(?<![\w.$}}~/]){place}" for place in _PLACES])
)


def names_a_machine(text: str) -> list[int]:
    """Numbers of the lines that name a package registry's host or a path of some machine."""
    return [number for number, line in enumerate(text.splitlines(), 1) if OF_ONE_MACHINE.search(line)]


def _tracked() -> list[str]:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files are tracked is unknown")
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode()
    return [name for name in listing.split("\0") if name and (ROOT / name).is_file()]


def test_no_tracked_file_names_a_machine() -> None:
    """GIVEN every tracked text file WHEN it is searched THEN no registry's host and no absolute path is in it."""
    found = {}
    for name in _tracked():
        data = (ROOT / name).read_bytes()
        if b"\0" not in data and (lines := names_a_machine(data.decode("utf-8"))):
            found[name] = lines
    assert found == {}


@pytest.mark.parametrize(
    ("line", "bad"),
    [
        ("https://py" + "pi.org/simple", True),
        ("path = '/wo" + "rk/main/x'", True),
        ("see /ho" + "me/ann/x", True),
        ("the framework (https://example.org/wo" + "rk/x)", False),
        ("../shared/data", False),
        ("$HOME/.cache", False),
    ],
)
def test_a_machine_is_recognised(line: str, bad: bool) -> None:
    """GIVEN a line WHEN it is judged THEN hosts of registries and paths of machines are found, others not."""
    assert bool(names_a_machine("ok\n" + line)) is bad


def test_no_run_or_table_is_tracked() -> None:
    """GIVEN the tracked files WHEN binaries are looked for THEN there are none but pictures of the documentation, and
    tables as they were certified beside the sets they were made of."""
    binaries = [name for name in _tracked() if b"\0" in (ROOT / name).read_bytes()]
    allowed = ("docs/images/*.png", "ground/tables/sets/*.tbl")
    assert [name for name in binaries if not any(fnmatch(name, pattern) for pattern in allowed)] == []
