"""What the operator may order on the screen: each order asked, confirmed where it flies, sent by `Operator`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from textual.app import App

from flightsw.icd.table_file import TableRefused
from ground.console import alarms, model, pages
from ground.console.link import Link
from ground.console.opm import read_opm
from ground.console.orders import Ask, Confirm, Menu, Order
from ground.console.table_diff import table_diff
from ground.console.uplink import Operator
from ground.errors import OperatorError


class Ordering(App[None]):
    """The half of the console that sends. `operator` is None where there is no way back."""

    link: Link
    operator: Operator | None
    state: model.State
    page: int
    chosen: int
    diff: tuple[str, ...]
    _operator_name: str

    if TYPE_CHECKING:  # the other half: view.py

        def redraw(self) -> None:
            """Show what has changed."""

        def action_page(self, page: int) -> None:
            """Turn to a page."""

        def _say(self, severity: int, text: str) -> None:
            """A line of the event log."""

    def action_differences(self) -> None:
        """Compare the table that flies, as it was read back, with a file."""
        if not self._may_order() or self.operator is None:
            return
        if not self.operator.table_read:
            self._say(4, "read the table that flies back first (r): nothing to compare a file with")
            self.redraw()
            return
        self.push_screen(Ask("Compare the table that flies with which table file?"), self._compare)

    def _compare(self, text: str | None) -> None:
        if not text or self.operator is None:
            return
        try:
            lines = table_diff(self.operator.table_read, Path(text).read_bytes())
        except OSError as error:
            self._say(4, f"{text}: cannot be read ({error.strerror})")
        except TableRefused as error:
            self._say(4, f"{text}: {error}")
        else:
            count = f"{len(lines) or 'no'} difference{'s' if len(lines) > 1 else ''}"
            self.diff = (f"{count}: the table that flies -> {Path(text).name}", *lines)
        self.action_page(pages.PAGES.index("tables"))

    def _may_order(self) -> bool:
        if self.operator is None:
            self._say(5, "this console only reads" if self.link.live else "a log cannot be commanded")
            self.redraw()
        return self.operator is not None

    def action_acknowledge(self) -> None:
        """Acknowledge the chosen alarm; on other pages the first that nobody has acknowledged."""
        alarm = pages.chosen_alarm(self.state, self.chosen if pages.PAGES[self.page] == "alarms" else 0)
        if alarm is None or alarm.acknowledged_s is not None or not self._may_order():
            return
        assert self.operator is not None

        def taken(accepted: bool) -> None:
            if accepted:
                now_s = self.link.now_s()
                done = alarms.acknowledge(self.state.alarms, alarm.sequence, now_s, self._operator_name)
                self.state = replace(self.state, alarms=done)

        self.operator.acknowledge(alarm.sequence, f"alarm #{alarm.sequence} acknowledged", taken)

    def action_orders(self) -> None:
        """Choose an order, confirm it, send it."""
        if self._may_order():
            self.push_screen(Menu(), self._confirm_order)

    def _confirm_order(self, order: Order | None) -> None:
        if order is not None:
            question = Confirm(f"Order flight: {order.label}?", order.means)
            self.push_screen(question, lambda sure: self._send(order) if sure else None)

    def _send(self, order: Order) -> None:
        assert self.operator is not None
        self.operator.command(order.number, order.values, order.label)

    def action_list_parameters(self) -> None:
        """Ask for all parameters again."""
        if self._may_order() and self.operator is not None:
            self.operator.list_parameters()

    def action_set_parameter(self) -> None:
        """Set the chosen parameter."""
        if pages.PAGES[self.page] != "parameters" or not self._may_order() or self.operator is None:
            return
        names = pages.parameter_names(self.operator)
        if self.chosen < len(names):
            name, operator = names[self.chosen], self.operator
            value = f"{operator.parameters[name][1]:g}"

            def entered(text: str | None) -> None:
                try:
                    if text is not None:
                        operator.set_parameter(name, float(text))
                except ValueError:
                    self._say(4, f"{text!r} is no number: nothing was sent")

            self.push_screen(Ask(f"{name} =", value), entered)

    def action_upload(self) -> None:
        """Send a table file up, validate and stage it."""
        if self._may_order():
            self.push_screen(Ask("Upload which table file? It is validated and staged, not activated."), self._upload)

    def _upload(self, text: str | None) -> None:
        if not text or self.operator is None:
            return
        try:
            data = Path(text).read_bytes()
        except OSError as error:
            self._say(4, f"{text}: cannot be read ({error.strerror})")
            return
        self.operator.upload_table(data, f"table {Path(text).name}")

    def action_read_back(self) -> None:
        """Read the table that flies back."""
        if self._may_order() and self.operator is not None:
            self.operator.read_table()

    def action_upload_state(self) -> None:
        """Send a state from the ground, to start from or to correct by."""
        if self._may_order():
            self.push_screen(Ask("Send the state of which orbit parameter message (OPM)?"), self._upload_state)

    def _upload_state(self, text: str | None) -> None:
        if not text or self.operator is None:
            return
        try:
            given = read_opm(Path(text))
        except OperatorError as error:
            self._say(4, str(error))
            return
        operator, label = self.operator, f"state {Path(text).name}"
        question = Confirm(
            f"Send flight the {label}?", "it starts from it, or corrects by it; not certified until fixes"
        )
        self.push_screen(
            question, lambda sure: operator.upload_state(given, label, lambda taken: None) if sure else None
        )
