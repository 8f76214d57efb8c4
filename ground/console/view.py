"""The screen: one page of panels redrawn a few times a second from the state. It decides nothing itself."""

from __future__ import annotations

from typing import Any, ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.screen import ModalScreen
from textual.widgets import Static
from textual_plotext import PlotextPlot

from ground.console import model, panels, plot
from ground.console.link import Link, TlogLink, damage_words, progress_words
from ground.console.verdict import STALE_S, Judgement, Level, judge

REDRAW_S = 0.25
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


class ConsoleApp(App[None]):
    """The operator's console on one screen; works from 100 x 30 characters."""

    TITLE = "leonav console"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar = [
        Binding("ctrl+c", "quit", "quit", show=False, priority=True),
        ("q", "quit", "quit"),
        ("question_mark", "help", "help"),
        ("p", "pause", "pause"),
    ]
    CSS = """
    Screen { layout: vertical; overflow: hidden; }
    Static { text-wrap: nowrap; text-overflow: ellipsis; }
    #header { height: 1; padding: 0 1; background: $panel; }
    #verdict { height: 4; padding: 0 1; border: heavy $secondary; }
    #verdict.good { border: heavy $success; }
    #verdict.caution { border: heavy $warning; }
    #verdict.bad { border: heavy $error; }
    #verdict.unknown { border: dashed $error; }
    #middle { height: 1fr; min-height: 12; }
    #plot { width: 1fr; height: 100%; border: round $secondary; padding: 0; }
    #values { width: 39; height: 100%; border: round $secondary; padding: 0 1; }
    #bottom { height: 8; }
    #events { width: 1fr; height: 100%; border: round $secondary; padding: 0 1; }
    #counters { width: 32; height: 100%; border: round $secondary; padding: 0 1; }
    #keys { height: 1; padding: 0 1; background: $panel; }
    """

    def __init__(self, link: Link, period_s: float = REDRAW_S) -> None:
        super().__init__()
        self.link = link
        self.state = model.State(started_s=link.now_s())
        self.judgement: Judgement | None = None
        self.paused = False
        self._period_s = period_s
        self._frozen: model.State | None = None
        if isinstance(link, TlogLink) and link.skipped_bytes:
            self.state = model.note(self.state, link.now_s(), 4, f"console: {damage_words(link.skipped_bytes)}")

    def compose(self) -> ComposeResult:
        """The panels from top to bottom."""
        yield Static(id="header")
        yield Static(id="verdict")
        with Horizontal(id="middle"):
            yield PlotextPlot(id="plot")
            yield Static(id="values")
        with Horizontal(id="bottom"):
            yield Static(id="events")
            yield Static(id="counters")
        yield Static(Text("q quit   ? help   p pause", style="bold"), id="keys")

    def on_mount(self) -> None:
        """Titles, then the first drawing and the timer."""
        for name in ("values", "events", "counters"):
            self.query_one(f"#{name}").border_title = name
        self.query_one("#counters").border_title = "rejected by cause"
        self.query_one("#plot").border_subtitle = "⠒ bound  ─ limit  ░ coasting  ▒ failed"
        self.step()
        self.set_interval(self._period_s, self.step)

    def step(self) -> None:
        """Take in what has arrived and draw; called by the timer, and by tests."""
        for time_s, message in self.link.receive():
            self.state = model.reduce(self.state, message, time_s)
        self.redraw()

    def redraw(self) -> None:
        """Draw every panel. The verdict and the values are always live; plot and events obey pause."""
        now_s = self.link.now_s()
        self.judgement = judge(self.state, now_s)
        shown = self._frozen or self.state
        screen = self.screen_stack[0]
        progress = progress_words(self.link) if isinstance(self.link, TlogLink) else ""
        header = panels.header(self.link, self.state, now_s, self.paused, progress)
        screen.query_one("#header", Static).update(header)
        box = screen.query_one("#verdict", Static)
        box.update(panels.verdict(self.judgement))
        box.set_classes(LEVEL_CLASSES[self.judgement.level])
        screen.query_one("#values", Static).update(panels.values(self.state, now_s))
        log = screen.query_one("#events", Static)
        log.border_subtitle = panels.alerts_line(shown)
        log.update(panels.events(shown.events, log.content_size.height))
        counts = screen.query_one("#counters", Static)
        counts.update(panels.counters(self.state, self.link.statistics, now_s, counts.content_size.height))
        self._draw_plot(screen.query_one("#plot", PlotextPlot), shown, now_s)

    def _draw_plot(self, widget: PlotextPlot, shown: model.State, now_s: float) -> None:
        size = widget.content_size
        if size.width < 20 or size.height < 6:
            return
        frozen = "PAUSED " if self._frozen else ""
        stale = "STALE " if model.age_s(now_s, shown.integrity_s) > STALE_S else ""
        widget.border_title = frozen + stale + plot.title(shown.history)
        plot.draw(widget.plt, shown.history, shown.history_step_s, size.width, size.height)
        widget.refresh()

    def action_help(self) -> None:
        """Show the help."""
        self.push_screen(Help())

    def action_pause(self) -> None:
        """Pause or go on: a replay stands still; live, only plot and events do."""
        self.paused = not self.paused
        self.link.pause(self.paused)
        self._frozen = self.state if self.paused else None
        self.redraw()

    async def action_quit(self) -> None:
        """Leave; also for ctrl-C."""
        self.exit()
