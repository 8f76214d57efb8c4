"""What the tests of timing hold the machine to: budgets.toml."""

import tomllib
from pathlib import Path
from typing import Any

BUDGETS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("budgets.toml").read_text(encoding="utf-8"))
