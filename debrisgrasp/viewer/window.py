"""The viewer: a page in the browser, served from here."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import Any

from debrisgrasp.errors import ConfigError, InputError, MissingExtraError
from debrisgrasp.executive.record import StoredRun
from debrisgrasp.io import Capture
from debrisgrasp.io.calibration_json import StoredCalibration
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import GraspMotions, PlanningResult
from debrisgrasp.prototypes import GraspPrototype, PrototypeLibrary, load_grippers

from .contents import PlanContent, RunContent, ViewContent
from .files import seen
from .other_views import CalibrationView, PrototypesView, RunView
from .plan_view import PlanView
from .stage import Stage

__all__ = ["Viewer", "show"]

Shown = (
    PlanningResult
    | Capture
    | GraspPrototype
    | PrototypeLibrary
    | StoredCalibration
    | StoredRun
    | ViewContent
)
View = PlanView | PrototypesView | CalibrationView | RunView


class Viewer:
    """A page that shows something, as long as this object is not closed.

    At the end of a notebook cell it is displayed in place.
    """

    def __init__(self, server: Any, view: View) -> None:
        self.server, self.view = server, view

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://localhost:{self.server.get_port()}"

    def close(self) -> None:
        """Stop serving the page."""
        with _silence():  # it says good-bye
            self.server.stop()

    def wait(self) -> None:
        """Serve until the program is interrupted."""
        try:
            self.server.sleep_forever()
        except KeyboardInterrupt:
            self.close()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        """Show the page in a notebook."""
        return (
            f'<iframe src="{escape(self.url)}" width="100%" height="620" '
            'style="border:1px solid #d5dae2"></iframe>'
        )


def show(
    thing: Shown,
    *,
    motions: GraspMotions | None = None,
    robot: RobotModel | None = None,
    port: int = 0,
    host: str = "127.0.0.1",
    block: bool = False,
) -> Viewer:
    """Show something in the browser, or at the end of a notebook cell.

    Parameters
    ----------
    thing
        A result of `debrisgrasp.plan`, a capture, a prototype or a dictionary of them,
        a stored calibration, a stored run, or what `content_of` read from a file.
    motions
        What `debrisgrasp.plan_motion` found for a plan: the robot moves along it.
    robot
        Shown beside a calibration or run.
    port
        Where to serve the page; 0 takes a free one.
    host
        On which address to listen; ``"0.0.0.0"`` lets other machines look too.
    block
        Serve until the program is interrupted, instead of returning at once.

    Returns
    -------
    Viewer
        With the address of the page; close it, or let the program end.

    Raises
    ------
    MissingExtraError
        If viser is not installed.
    InputError
        If it is nothing that can be shown.
    ConfigError
        If the port is taken, or the address is none of this machine.
    """
    content = _content(thing, motions, robot)
    server = _started(host, port)
    try:
        view = _view(Stage(server), content, robot)
    except BaseException:
        server.stop()
        raise
    viewer = Viewer(server, view)
    if block:
        viewer.wait()
    return viewer


def _content(
    thing: Shown, motions: GraspMotions | None, robot: RobotModel | None
) -> ViewContent:
    if isinstance(thing, PlanningResult):
        chosen = None if motions is None else motions.chosen
        return PlanContent(
            title=thing.capture.name,
            capture=thing.capture,
            cloud=thing.cloud,
            segmentation=thing.segmentation,
            order=thing.order,
            plan=thing.plan,
            grippers=thing.grippers,
            robot=thing.robot,
            dictionary=thing.dictionary,
            motions={} if chosen is None else chosen.trajectories,
            motion_grasp=0 if chosen is None else chosen.index,
            motion_arm="" if chosen is None else chosen.arm,
        )
    if isinstance(thing, Capture):
        return seen(thing.name, thing)
    if isinstance(thing, GraspPrototype):
        return PrototypeLibrary((thing,), load_grippers())
    if isinstance(thing, StoredRun):
        return RunContent(run=thing, robot=robot)
    if isinstance(
        thing, PlanContent | RunContent | PrototypeLibrary | StoredCalibration
    ):
        return thing
    raise InputError(
        "what to show",
        got=type(thing).__name__,
        expected="a plan, capture, prototype, calibration or run",
        mend="content_of(path) reads files.",
    )


def _view(stage: Stage, content: ViewContent, robot: RobotModel | None) -> View:
    if isinstance(content, PlanContent):
        return PlanView(stage, content)
    if isinstance(content, PrototypeLibrary):
        return PrototypesView(stage, content)
    if isinstance(content, StoredCalibration):
        return CalibrationView(stage, content, robot)
    return RunView(stage, content)


@contextmanager
def _silence() -> Iterator[None]:
    """Keep what the server says off the terminal, and out of notebooks."""
    console = import_module("rich").get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _started(host: str, port: int) -> Any:
    """Start a server with our looks."""
    try:
        viser = import_module("viser")
    except ImportError as error:
        raise MissingExtraError("the viewer", "viz") from error
    with _silence():  # it prints its address even if not verbose
        server = viser.ViserServer(host, _free_port(host, port), verbose=False)
    server.gui.configure_theme(
        control_width="large",
        show_logo=False,
        show_share_button=False,
        brand_color=(26, 98, 198),
    )
    server.gui.main_panel.dock_right()
    return server


def _free_port(host: str, port: int) -> int:
    """Return the port, or a free one for 0; raise if it is taken."""
    with socket.socket() as probe:
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            raise ConfigError(
                f"port {port} of {host}",
                got=getattr(error, "strerror", None) or str(error),
                expected="a free port of this machine",
                mend="Port 0 takes any that is free.",
            ) from error
        return int(probe.getsockname()[1])
