"""The screen: one page of panels redrawn a few times a second from the state. It decides nothing itself."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from contextlib import suppress
from typing import Any, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.screen import ModalScreen
from textual.widgets import Static
from textual_plotext import PlotextPlot

from ground.console import alarms, gnss, model, pages, panels, plot
from ground.console.crosslink_page import crosslink_page
from ground.console.event_log import Filter, events_page
from ground.console.link import Link, Sending
from ground.console.ordering import Ordering
from ground.console.orders import Ask
from ground.console.timing_page import timing_page
from ground.console.tlog import TlogLink, progress_words
from ground.console.uplink import Operator
from ground.console.verdict import STALE_S, Judgement, Level, judge_link

REDRAW_S = 0.25
SEEK_S = 60.0
LEVEL_CLASSES = {level: level.name.lower() for level in Level}


class Help(ModalScreen[None]):
    """What the words mean and what the keys do."""

    CSS = """
    Help { align: center middle; }
    Help > Static { width: 82; height: auto; padding: 1 2; border: round $accent; background: $surface; }
    """

    def compose(self) -> ComposeResult:
        """One box of text."""
        yield Static(Text(panels.HELP_TEXT), id="help")

    def on_key(self, event: Any) -> None:
        """Any key closes it."""
        event.stop()
        if self.is_current:  # a second key may already wait behind the one that closed it
            self.dismiss()


class ConsoleApp(Ordering):
    """The operator's console on one screen; works from 100 x 30 characters."""

    TITLE = "leonav console"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar = [
        Binding("ctrl+c", "quit", "quit", show=False, priority=True),
        ("q", "quit", "quit"),
        ("question_mark", "help", "help"),
        ("p", "pause", "pause"),
        ("x", "axes", "axes in the plot"),
        *((str(number % 10), f"page({number - 1})", name) for number, name in enumerate(pages.PAGES, 1)),
        Binding("tab", "page(-1)", "next page", priority=True),
        ("up", "choose(-1)", "choose"),
        ("down", "choose(1)", "choose"),
        ("a", "acknowledge", "acknowledge"),
        ("o", "orders", "orders"),
        ("l", "list_parameters", "list parameters"),
        ("s", "set_parameter", "set parameter"),
        ("u", "upload", "upload"),
        ("n", "upload_state", "send a state"),
        ("r", "read_back", "read back"),
        ("d", "differences", "differences"),
        ("f", "severity", "severity"),
        ("slash", "search", "search"),
        ("left", "seek(-1)", "back"),
        ("right", "seek(1)", "on"),
        ("plus", "speed(2)", "faster"),
        ("minus", "speed(0.5)", "slower"),
    ]
    CSS = """
    Screen { layout: vertical; overflow: hidden; }
    Static { text-wrap: nowrap; text-overflow: ellipsis; }
    #plot, #values, #events, #counters, #page { border-title-color: $text; border-subtitle-color: $text-muted; }
    #header { height: 1; padding: 0 1; background: $panel; }
    #verdict { height: 4; padding: 0 1; border: heavy $primary; }
    #verdict.good { border: heavy $success; }
    #verdict.caution { border: heavy $warning; }
    #verdict.bad { border: heavy $error; }
    #verdict.unknown { border: dashed $error; }
    #middle { height: 1fr; min-height: 12; }
    #plot { width: 1fr; height: 100%; border: round $primary; padding: 0; }
    #values { width: 39; height: 100%; border: round $primary; padding: 0 1; }
    #bottom { height: 8; }
    #events { width: 1fr; height: 100%; border: round $primary; padding: 0 1; }
    #counters { width: 32; height: 100%; border: round $primary; padding: 0 1; }
    #page { height: 1fr; border: round $primary; padding: 0 1; }
    #keys { height: 1; padding: 0 1; background: $panel; }
    """

    def __init__(self, link: Link, period_s: float = REDRAW_S, operator_name: str = "operator") -> None:
        super().__init__()
        self.link = link
        self.operator: Operator | None = None
        if isinstance(link, Sending):
            self.operator = Operator(link.send, link.verifier, self._say)
        self.page = 0
        self.chosen = 0  # the marked line; on the page of events, lines scrolled back
        self.filter = Filter()
        self.diff: tuple[str, ...] = ()
        self._operator_name = operator_name
        self._asked_events_s = 0.0
        self.state = model.State(started_s=link.now_s())
        self.judgement: Judgement | None = None
        self.paused = False
        self.by_axis = False  # the plot
        self._period_s = period_s
        self._frozen: model.State | None = None
        for remark in link.remarks if isinstance(link, TlogLink) else ():
            self.state = model.note(self.state, link.now_s(), 4, f"console: {remark}")

    def compose(self) -> ComposeResult:
        """The panels from top to bottom."""
        yield Static(id="header")
        yield Static(id="verdict")
        with Horizontal(id="middle"):
            yield PlotextPlot(id="plot")
            yield Static(id="values")
        yield Static(id="page")
        with Horizontal(id="bottom"):
            yield Static(id="events")
            yield Static(id="counters")
        yield Static(id="keys")

    def on_mount(self) -> None:
        """Titles, then the first drawing and the timer."""
        for name in ("values", "events", "counters"):
            self.query_one(f"#{name}").border_title = name
        self.query_one("#counters").border_title = "rejected by cause"
        self._show_page()
        with suppress(NotImplementedError, RuntimeError):  # where the system has no such signal
            asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, self.exit)
        self.step()
        self.set_interval(self._period_s, self.step)

    def step(self) -> None:
        """Take in what has arrived and draw; called by the timer, and by tests."""
        for time_s, message in self.link.receive():
            self.state = model.reduce(self.state, message, time_s)
            if self.operator is not None:
                self.operator.take(message)
        if self.operator is not None:
            self._ask_for_lost_events()
            self.operator.step(self.link.now_s())
        self.redraw()

    def _ask_for_lost_events(self) -> None:
        told, now_s = self.state.link, self.link.now_s()
        if told is None or self.operator is None or now_s - self._asked_events_s < 2.0:
            return
        heard = {sequence for sequence, _, _ in self.state.recent_alerts}
        first = max(1, (min(heard) if heard else told.event_sequence), told.event_sequence - model.RECENT_EVENTS + 1)
        missing = [k for k in range(first, told.event_sequence + 1) if k not in heard]
        if missing and len(heard) < model.RECENT_ALERTS:
            self._asked_events_s = now_s
            self.operator.request_events(missing[0], missing[-1])

    def _say(self, severity: int, text: str) -> None:
        self.state = model.note(self.state, self.link.now_s(), severity, f"console: {text}")

    def redraw(self) -> None:
        """Draw every panel. The verdict and the values are always live; plot and events obey pause."""
        now_s = self.link.now_s()
        self.judgement = judge_link(self.state, now_s, self.link)
        shown = self._frozen or self.state
        screen = self.screen_stack[0]
        progress = progress_words(self.link) if isinstance(self.link, TlogLink) else ""
        header = panels.header(self.link, self.state, now_s, self.paused, progress)
        screen.query_one("#header", Static).update(header)
        box = screen.query_one("#verdict", Static)
        box.update(panels.verdict(self.judgement))
        box.set_classes(LEVEL_CLASSES[self.judgement.level])
        screen.query_one("#values", Static).update(panels.values(self.state, now_s))
        screen.query_one("#keys", Static).update(panels.keys(self.page, self.operator is not None, self.link.live))
        if self.page:
            self._draw_page(screen.query_one("#page", Static), now_s)
        log = screen.query_one("#events", Static)
        log.border_subtitle = panels.alerts_line(shown)
        log.update(panels.events(shown.events, log.content_size.height))
        counts = screen.query_one("#counters", Static)
        counts.update(panels.counters(self.state, self.link.statistics, now_s, counts.content_size.height))
        self._draw_plot(screen.query_one("#plot", PlotextPlot), shown, now_s)

    def _draw_page(self, widget: Static, now_s: float) -> None:
        rows = max(4, widget.content_size.height)
        drawn: tuple[Callable[[], Text], ...] = (
            Text,
            lambda: pages.alarms(self.state, self.chosen, rows),
            lambda: pages.filter_page(self.state, now_s),
            lambda: pages.link_page(self.state, self.link.statistics, self.operator, now_s),
            lambda: pages.tables_page(self.state, self.operator, now_s, self.diff, rows),
            lambda: pages.parameters_page(self.operator, self.chosen, rows),
            lambda: events_page((self._frozen or self.state).events, self.filter, self.chosen, rows),
            lambda: timing_page(self.state, now_s, rows),
            lambda: gnss.page(self.state.gnss, panels.stale_mark(now_s, self.state.gnss_s)),
            lambda: crosslink_page(self.state, now_s),
        )
        widget.border_title = pages.PAGES[self.page]
        widget.update(drawn[self.page]())

    def _show_page(self) -> None:
        screen = self.screen_stack[0]
        for name in ("#middle", "#bottom"):
            screen.query_one(name).display = self.page == 0
        screen.query_one("#page").display = self.page != 0

    def action_page(self, number: int) -> None:
        """Turn to a page; -1: the next one."""
        self.page = (self.page + 1) % len(pages.PAGES) if number < 0 else number
        self.chosen = 0
        self._show_page()
        if pages.PAGES[self.page] == "parameters" and self.operator is not None and not self.operator.parameters:
            self.operator.list_parameters()
        self.redraw()

    def action_choose(self, step: int) -> None:
        """Mark the line above or below."""
        lines = len(alarms.standing(self.state.alarms))
        if pages.PAGES[self.page] == "parameters" and self.operator is not None:
            lines = len(self.operator.parameters)
        elif pages.PAGES[self.page] == "events":
            lines, step = len(self.filter.select((self._frozen or self.state).events)), -step
        self.chosen = min(max(0, self.chosen + step), max(0, lines - 1))
        self.redraw()

    def action_severity(self) -> None:
        """Show graver events only, or all again."""
        self._show_events(self.filter.next_level())

    def action_search(self) -> None:
        """Show events with a word in them; an empty word, all."""

        def entered(word: str | None) -> None:
            if word is not None:
                self._show_events(self.filter._replace(word=word.strip()))

        self.push_screen(Ask("Show events with which word? Empty: all.", self.filter.word), entered)

    def _show_events(self, chosen: Filter) -> None:
        self.filter = chosen
        self.action_page(pages.PAGES.index("events"))

    # -- replay

    def action_seek(self, steps: int) -> None:
        """Go on or back in a log."""
        if isinstance(self.link, TlogLink):
            if self.link.seek(steps * SEEK_S):
                self.state = model.State(started_s=self.link.start_s)
            self._frozen = None
            self.step()

    def action_speed(self, factor: float) -> None:
        """Replay faster or slower."""
        if isinstance(self.link, TlogLink):
            self._say(6, f"replay at {self.link.faster(factor):g} times real time")

    def _draw_plot(self, widget: PlotextPlot, shown: model.State, now_s: float) -> None:
        size = widget.content_size
        if size.width < 20 or size.height < 6:
            return
        frozen = "PAUSED " if self._frozen else ""
        stale = "STALE " if model.age_s(now_s, shown.integrity_s) > STALE_S else ""
        widget.border_title = frozen + stale + plot.title(shown.history)
        drawn = "x y z axes  3 in space" if self.by_axis else "⠒ bound"
        widget.border_subtitle = f"{drawn}  ─ limit  ░ coasting  ▒ failed"
        plot.draw(widget.plt, shown.history, shown.history_step_s, size.width, size.height, self.by_axis)
        widget.refresh()

    def action_help(self) -> None:
        """Show the help."""
        self.push_screen(Help())

    def action_axes(self) -> None:
        """Plot the levels of the axes, or the bound again."""
        self.by_axis = not self.by_axis
        self.redraw()

    def action_pause(self) -> None:
        """Pause or go on: a replay stands still; live, only plot and events do."""
        self.paused = not self.paused
        self.link.pause(self.paused)
        self._frozen = self.state if self.paused else None
        self.redraw()

    async def action_quit(self) -> None:
        """Leave; also for ctrl-C."""
        self.exit()
