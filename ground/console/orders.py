"""Dialogs: what may be ordered of flight, each order confirmed before it leaves; and a line of input."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from flightsw.icd import mavlink as m
from flightsw.icd.enums import EditMode, Mode


class Order(NamedTuple):
    """One entry of the menu: key, words, command and its parameters, what it means."""

    key: str
    label: str
    number: int
    values: tuple[float, ...]
    means: str


_EDIT = m.LEONAV_CMD_EDIT
ORDERS = (
    Order("1", "mode INTEGRATED", m.MAV_CMD_DO_SET_MODE, (1.0, float(Mode.INTEGRATED)), "the gate decides about fixes"),
    Order("2", "mode AUTONOMOUS", m.MAV_CMD_DO_SET_MODE, (1.0, float(Mode.AUTONOMOUS)), "no fix is used any more"),
    Order("3", "positions: auto", _EDIT, (0.0, float(EditMode.AUTO)), "the gate decides about positions"),
    Order("4", "positions: reject", _EDIT, (0.0, float(EditMode.REJECT)), "tested and recorded, never used"),
    Order("5", "velocities: auto", _EDIT, (1.0, float(EditMode.AUTO)), "the gate decides about velocities"),
    Order("6", "velocities: reject", _EDIT, (1.0, float(EditMode.REJECT)), "tested and recorded, never used"),
    Order("7", "reset the filter", m.LEONAV_CMD_RESET_FILTER, (), "the state is forgotten until fixes agree again"),
    Order("8", "arm the flag", m.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), "a raised flag withdraws the state"),
    Order("9", "disarm the flag", m.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,), "a raised flag is told and no more"),
    Order("a", "activate the staged table", m.LEONAV_CMD_TABLE_ACTIVATE, (), "it flies on trial from the next tick"),
    Order("b", "roll back the table on trial", m.LEONAV_CMD_TABLE_ROLL_BACK, (), "the table of before flies again"),
    Order("c", "restart flight", m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (1.0,), "flight ends and is started again"),
)
_BOX = "width: 84; height: auto; padding: 1 2; border: round $accent; background: $surface;"


class Menu(ModalScreen[Order | None]):
    """The orders; a key chooses one, escape none."""

    CSS = f"Menu {{ align: center middle; }} Menu > Static {{ {_BOX} }}"

    def compose(self) -> ComposeResult:
        """One box of text."""
        text = Text("What is flight to do?\n\n", style="bold")
        for order in ORDERS:
            text.append(f" {order.key}  ", style="bold")
            text.append(f"{order.label:<30}{order.means}\n", style="default")
        text.append("\nescape: nothing", style="dim")
        yield Static(text, id="menu")

    def on_key(self, event: Any) -> None:
        """Choose, or leave."""
        event.stop()
        chosen = next((order for order in ORDERS if order.key == event.character), None)
        if self.is_current and (chosen is not None or event.key == "escape"):
            self.dismiss(chosen)


class Confirm(ModalScreen[bool]):
    """Nothing leaves without this: y sends, anything else does not."""

    CSS = f"Confirm {{ align: center middle; }} Confirm > Static {{ {_BOX} }}"

    def __init__(self, question: str, means: str) -> None:
        super().__init__()
        self._question, self._means = question, means

    def compose(self) -> ComposeResult:
        """The question."""
        text = Text(f"{self._question}\n", style="bold")
        text.append(f"{self._means}\n\n", style="default")
        text.append("y", style="bold reverse")
        text.append(" send it   any other key: no", style="default")
        yield Static(text, id="confirm")

    def on_key(self, event: Any) -> None:
        """Send or not."""
        event.stop()
        if self.is_current:
            self.dismiss(event.character == "y")


class Ask(ModalScreen[str | None]):
    """One line of input; escape gives None."""

    CSS = f"Ask {{ align: center middle; }} Ask > Vertical {{ {_BOX} }}"
    BINDINGS: ClassVar = [Binding("escape", "leave", "leave")]

    def __init__(self, question: str, value: str = "") -> None:
        super().__init__()
        self._question, self._value = question, value

    def compose(self) -> ComposeResult:
        """The question and the line."""
        with Vertical():
            yield Static(Text(self._question, style="bold"))
            yield Input(value=self._value, id="line")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter was pressed."""
        self.dismiss(event.value)

    def action_leave(self) -> None:
        """Nothing was meant."""
        self.dismiss(None)
