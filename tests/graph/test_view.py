"""The live page of a running graph, in a browser: it shows, takes orders from who may give them, and survives the rest.

Needs Chromium, as Debian packages it; without it these tests are left out.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import pytest

from amb_core.excitation import Square, generate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from tests.graph.bearing import Bearing
from tests.graph.conftest import Graph
from tests.graph.live_page import CHROMIUM, LivePage, Visit, attack, open_browser, publish_markup
from tests.graph.rig import Rig

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = [pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium"), pytest.mark.timeout(300)]

COMPOSED, GENERATOR = "amb_bringup.graph.composed_loop", "amb_controller_node.excitation_generator"
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
DRAWN = "ambView.measured.drawn"


class Watched:
    """A loop that runs, its server, and a browser."""

    def __init__(self, graph: Graph, browser: Any) -> None:
        self.graph, self.browser = graph, browser
        for module in (COMPOSED, GENERATOR):
            graph.start(module)
        self.bearing = Bearing(graph)
        self.server = LivePage(graph)

    def visit(self, address: str = "", **options: Any) -> Visit:
        visit = Visit(self.browser, address or self.server.address, **options)
        visit.wait("ambView.state.sections.graph?.alive && ambView.state.sections.machine")
        return visit


@pytest.fixture(scope="module")
def watched(open_graph: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    with open_graph(tmp_path_factory.mktemp("view")) as graph, open_browser() as browser:
        yield Watched(graph, browser)


@pytest.fixture(scope="module")
def master(watched: Watched) -> Visit:
    """The page with the token; the loop runs."""
    visit = watched.visit(watched.server.address_with_token)
    visit.wait("!document.getElementById('controls').disabled")
    visit.order("Run", "until paused")
    visit.wait(f"{DRAWN} > 3")
    return visit


def test_the_page_draws_the_running_machine_and_asks_for_nothing_outside_itself(
    watched: Watched, master: Visit
) -> None:
    assert "x, y in 1 bearing, 10 kHz" in master.text("#machine")
    step = master.value("ambView.samples.step")
    master.wait(f"ambView.samples.step > {step} && ambView.samples.spectrum")
    assert master.value("ambView.samples.layout.planes.length") == 1
    assert master.value("ambView.samples.low.some(Number.isFinite)")
    assert all(address.startswith(watched.server.address) for address in master.requests)
    assert master.complaints == []


def test_the_token_is_not_left_in_the_address(watched: Watched, master: Visit) -> None:
    assert master.page.url == watched.server.address


def test_excitations_are_started_and_stopped_from_the_page(master: Visit) -> None:
    master.page.locator("#kind").select_option("square")
    master.page.locator("[data-name=amplitude]").fill("5")
    master.page.locator("[data-name=duration]").fill("20")
    master.order("Start excitation", "square from step")
    master.page.locator("#excitation", has_text="Excitation: square").wait_for()
    master.page.locator("h1").click()
    master.page.keyboard.press("Escape")
    master.page.locator("#answer", has_text="excitation stopped").wait_for()


def test_an_order_that_is_not_possible_is_answered_with_the_reason(master: Visit) -> None:
    master.page.locator("#kind").select_option("sweep")
    for name, value in {"amplitude": "5", "duration": "1", "axes": "w"}.items():
        master.page.locator(f"[data-name={name}]").fill(value)
    master.order("Start excitation", "axes = 'w' is not allowed")
    assert master.page.locator("#answer").get_attribute("data-ok") == "false"


def test_the_end_of_an_order_is_shown_below_a_later_one(master: Visit) -> None:
    master.page.locator("#kind").select_option("sweep")
    for name, value in {"amplitude": "5", "duration": "1", "axes": "w"}.items():
        master.page.locator(f"[data-name={name}]").fill(value)
    orders = "document.getElementById('excite').requestSubmit(); document.querySelector('[data-order=run]').click()"
    master.value(orders)
    ended = master.page.locator("#ends li", has_text="axes = 'w' is not allowed")
    ended.wait_for()
    assert (ended.text_content() or "").startswith("start excitation: ")
    assert ended.get_attribute("data-ok") == "false"
    master.wait("!document.getElementById('answer').textContent.endsWith('…')")  # that of the later order


def test_a_wrong_field_is_named_in_the_words_and_units_of_the_page(master: Visit) -> None:
    master.page.locator("#kind").select_option("sweep")
    for amplitude, complaint in {
        "5000": "amplitude = 5000 µm is not allowed; allowed: 0.001 to 1000 µm",
        "a lot": "amplitude = a lot µm is not allowed; allowed: 0.001 to 1000 µm",
        "": "amplitude is missing; allowed: 0.001 to 1000 µm",
    }.items():
        master.page.locator("[data-name=duration]").fill("1")
        master.page.locator("[data-name=amplitude]").fill(amplitude)
        master.order("Start excitation", complaint)
        assert master.page.locator("#answer").get_attribute("data-ok") == "false"


def test_orders_and_their_answers_are_in_sight_without_scrolling(watched: Watched) -> None:
    visit = watched.visit(watched.server.address_with_token, viewport={"width": 1280, "height": 800})
    visit.wait("!document.getElementById('controls').disabled")
    visit.order("Pause", "paused")
    for place in ("#answer", "button:text-is('Identify')", "button:text-is('Certify')", "button:text-is('Stop')"):
        box = visit.page.locator(place).bounding_box()
        assert box is not None and box["y"] + box["height"] <= 800, (place, box)
    visit.order("Run", "in real time until paused")
    visit.close()


def test_the_spectrum_shows_nothing_below_what_a_sensor_sees(master: Visit) -> None:
    shown = "import('./spectrum.js').then((module) => module.decades({}))"
    assert master.value(shown.format("1e-16")) == [-10, -8]
    assert master.value(shown.format("2e-5")) == [-9, -4]


def test_the_keyboard_freezes_the_page_and_chooses_windows_and_signals(master: Visit) -> None:
    master.page.locator("h1").click()  # on a button the space bar presses that
    keys = master.page.keyboard
    keys.press("1")
    assert master.value("ambView.samples.level") == 0
    master.wait("ambView.samples.high.some(Number.isFinite)")
    keys.press("s")
    assert master.page.locator("#signal").input_value() == "current"
    keys.press("z")
    assert master.page.locator("#zoom").get_attribute("aria-pressed") == "true"
    keys.press("Space")
    step = master.value("ambView.samples.step")
    master.page.wait_for_timeout(200)  # several frames of the server
    assert master.value("ambView.samples.step") == step
    keys.press("Space")
    master.wait(f"ambView.samples.step > {step}")
    for key in ("3", "s", "z"):
        keys.press(key)


def test_tab_reaches_what_can_be_pressed(watched: Watched) -> None:
    visit = watched.visit()
    visit.page.keyboard.press("Tab")
    assert visit.value("document.activeElement.textContent") == "Skip to the traces"
    reached = set()
    for _ in range(8):
        visit.page.keyboard.press("Tab")
        reached.add(visit.value("document.activeElement.id"))
    visit.close()
    assert {"zoom", "signal", "window", "freeze"} <= reached


@pytest.mark.parametrize("options", [{}, {"color_scheme": "dark"}, PHONE], ids=["light", "dark", "phone"])
def test_the_page_fits_the_screen_and_its_text_stands_out(watched: Watched, master: Visit, options: Any) -> None:
    visit = watched.visit(**options)
    visit.wait(f"{DRAWN} > 1")
    assert visit.value("document.documentElement.scrollWidth <= window.innerWidth")
    shades = visit.value(
        """[getComputedStyle(document.body).color, getComputedStyle(document.body).backgroundColor]
            .map(text => text.match(/[0-9]+/g).slice(0, 3).reduce((sum, part) => sum + Number(part), 0) / 765)"""
    )
    visit.close()
    assert abs(shades[0] - shades[1]) > 0.6
    assert (shades[0] > shades[1]) == (options.get("color_scheme") == "dark")


def test_markup_in_the_log_is_shown_as_text(watched: Watched, master: Visit) -> None:
    publisher = publish_markup(watched.graph)
    master.page.locator("#log-list li", has_text="globalThis.executed").first.wait_for()
    watched.graph.node.destroy_publisher(publisher)
    assert master.value("globalThis.executed") is None
    assert master.page.locator("#log-list img").count() == 0


def test_a_page_without_the_token_shows_and_orders_nothing(watched: Watched, master: Visit) -> None:
    visit = watched.visit()
    assert visit.page.get_by_role("button", name="Identify").is_disabled()
    assert "read-only" in visit.text("#lock").lower()
    visit.close()


def test_other_hosts_and_origins_are_refused(watched: Watched) -> None:
    server = watched.server
    ours, host = server.address.rstrip("/"), f"{server.host}:{server.port}"
    assert server.status() == 200
    assert server.status(Host="evil.example") == 403
    assert server.upgrade_status(Host=host, Origin=ours) == 101
    assert server.upgrade_status(Host=host) == 403
    assert server.upgrade_status(Host=host, Origin="http://evil.example") == 403
    assert server.upgrade_status(Host="evil.example", Origin="http://evil.example") == 403
    for path in ("/../../etc/passwd", "/%2e%2e/server.py", "/server.py", "//evil.example/"):
        assert server.status(path) == 404


@pytest.mark.slow
def test_a_hostile_client_gets_nothing_done_and_the_server_lives(watched: Watched, master: Visit) -> None:
    visit = watched.visit()
    assert attack(visit, watched.server.address) == 0
    visit.close()
    drawn = master.value(DRAWN)
    master.wait(f"{DRAWN} > {drawn + 5}")
    assert watched.server.process.poll() is None


@pytest.mark.slow
def test_ten_pages_are_served_at_once(watched: Watched, master: Visit) -> None:
    visits = [watched.visit() for _ in range(10)]
    for visit in visits:
        visit.wait(f"{DRAWN} > 5")
    steps = [visit.value("ambView.samples.step") for visit in visits]
    assert min(steps) > 0
    for visit in visits:
        visit.close()


def test_the_samples_of_the_loop_are_the_same_with_the_page_open(watched: Watched, master: Visit) -> None:
    steps, first_step = 1_050, 200
    square = Square(amplitude=20e-6, duration=0.08, frequency=50.0, axes="in_turn")
    expected = simulate(
        Plant(), PdController(ControllerParameters()), steps, generate(square, 10_000.0).samples, first_step
    )
    bearing = watched.bearing
    run = bearing.reset()
    bearing.excite(square, run, first_step)
    bearing.run(steps)
    assert bearing.record(run, steps).identical_to(expected)
    master.wait(f"ambView.samples.layout.run === {run} && ambView.samples.step === {steps}")


@pytest.mark.slow
def test_a_graph_that_goes_away_and_comes_back_is_shown(watched: Watched, master: Visit) -> None:
    graph = watched.graph
    run = master.value("ambView.samples.layout.run")
    graph.stop(graph.process_of(COMPOSED))
    graph.stop(graph.process_of(GENERATOR))
    master.page.locator("#banner", has_text="The graph is away").wait_for()
    assert master.page.locator("#dot").get_attribute("data-state") == "away"
    for module in (COMPOSED, GENERATOR):
        graph.start(module)
    master.page.locator("#banner").wait_for(state="hidden")
    master.order("Run", "until paused")
    master.wait(f"ambView.samples.layout.run > {run} && ambView.samples.step > 100")


@pytest.mark.slow
def test_a_server_that_goes_away_is_shown_and_its_end_is_clean(watched: Watched) -> None:
    server = LivePage(watched.graph)
    visit = watched.visit(server.address)
    code, said = watched.graph.stop(server.process, signal.SIGTERM)
    visit.page.locator("#banner", has_text="No connection to the server").wait_for()
    visit.close()
    assert (code, said.strip()) == (0, "amb: stopped")


@pytest.mark.slow
def test_a_rig_is_levitated_and_landed_from_the_page_and_its_trips_are_shown(watched: Watched, graph: Graph) -> None:
    rig = Rig(graph)
    graph.start("amb_ident_node.region_monitor")
    server = LivePage(graph)
    visit = Visit(watched.browser, server.address_with_token)
    visit.wait("!document.getElementById('controls').disabled && ambView.state.sections.plant")
    visit.order("Levitate", "activate is allowed while it is inactive")
    assert rig.change("configure"), rig.state.problem
    visit.order("Levitate", "levitated")
    visit.wait("ambView.samples.step > 1000")
    lamp = visit.page.locator("#lamps .lamp").first
    visit.page.locator("#lamps .lamp[data-region=A]").first.wait_for()
    visit.order("Land", "landed")
    visit.order("Levitate", "levitated")
    visit.order("Off", "off")
    visit.page.locator("#lamps .lamp[data-region=none]").first.wait_for()
    assert lamp.text_content() == "–"
    visit.order("Levitate", "levitated")
    graph.stop(rig.emulator, signal.SIGKILL)
    visit.page.locator("#trip-list li", has_text="does not answer").wait_for()
    visit.page.locator("#banner").wait_for()
    visit.page.locator("#lamps .lamp[data-region=none]").first.wait_for()
    graph.stop(rig.bridge, signal.SIGKILL)
    visit.page.locator("#status-text", has_text="rig away").wait_for()
    visit.page.locator("#banner", has_text="what it does now is not known").wait_for()
    assert visit.value("ambView.state.sections.graph.alive")
    visit.close()
