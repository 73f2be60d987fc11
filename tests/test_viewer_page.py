"""The viewer's page in a real browser, and what reaches it: needs chromium and playwright."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import threading

import numpy as np
import pytest

pytest.importorskip("viser")
pytest.importorskip("playwright.sync_api")

from playwright import sync_api as playwright

import niryo_jax as nj
from niryo_jax.hardware import SimulatedNiryo
from niryo_jax.hardware.pick_and_place import OBJECT_END
from niryo_jax.viewer import Viewer
from niryo_jax.workspace.orientations import rotations_of

needs_pyniryo = pytest.mark.skipif(
    importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
)
NAMES = "chromium", "chromium-browser", "google-chrome"
# WebGL without a graphics card.
FLAGS = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
]
SIZE = {"width": 1200, "height": 900}
PATIENCE = 60_000
PICTURES = os.environ.get("NIRYO_JAX_VIEWER_PICTURES")
"""A folder for pictures of the page, to be looked at."""


@pytest.fixture(scope="module")
def browser():
    """A browser that playwright brings, or one of the system."""
    with playwright.sync_playwright() as driver:
        found = next(filter(None, map(shutil.which, NAMES)), None)
        try:
            started = driver.chromium.launch(executable_path=found, args=FLAGS)
        except playwright.Error as error:
            pytest.skip(f"no browser can be started: {str(error).splitlines()[0]}")
        yield started
        started.close()


@pytest.fixture(scope="module")
def viewer():
    with Viewer(nj.robots.niryo_one(), port=0) as started:
        yield started


@pytest.fixture
def page(viewer, browser):
    """A page that is ready; nothing may go wrong in it."""
    errors = []
    opened = browser.new_page(viewport=SIZE)
    opened.on("pageerror", lambda error: errors.append(error))
    viewer.show_joints(viewer.session.start)
    opened.goto(viewer.url)
    opened.wait_for_selector("canvas", timeout=PATIENCE)
    opened.get_by_text("Complete: yes").wait_for(timeout=PATIENCE)
    wait(opened, lambda: viewer.server.get_clients())
    # What is drawn first comes in softly.
    opened.wait_for_timeout(3000)
    yield opened
    opened.close()
    assert errors == []


def wait(page, holds):
    """Wait until something holds here, while the browser goes on."""
    for _ in range(PATIENCE // 100):
        if holds():
            return
        page.wait_for_timeout(100)
    pytest.fail("it did not happen in time")


def picture(page, name):
    """A picture of the page; how many colours there are in the scene, left of the panel."""
    imageio = pytest.importorskip("imageio.v3")
    taken = page.screenshot()
    if PICTURES:
        with open(os.path.join(PICTURES, f"{name}.png"), "wb") as file:
            file.write(taken)
    pixels = imageio.imread(taken, extension=".png")[200:, :750, :3]
    return len(np.unique(pixels.reshape(-1, 3), axis=0))


def on_screen(viewer, point):
    """Where a point (3,) of the scene is on the page, pixels."""
    camera = next(iter(viewer.server.get_clients().values())).camera
    seen = rotations_of(np.asarray(camera.wxyz)).T @ (np.asarray(point) - camera.position)
    scale = SIZE["height"] / 2 / np.tan(camera.fov / 2)
    return SIZE["width"] / 2 + scale * seen[0] / seen[2], SIZE["height"] / 2 + scale * (
        seen[1] / seen[2]
    )


def test_an_arm_is_drawn_and_its_solutions_are_told(viewer, page):
    assert picture(page, "start") > 1000
    view = viewer.view
    within = f"Solutions: {np.sum(view.found)}, {np.sum(view.within)} within the limits"
    assert page.get_by_text(within).is_visible()
    assert page.get_by_text("Clearance:").is_visible()
    assert page.locator("table tr").count() == 1 + np.sum(view.found)


def test_a_slider_moves_the_arm_and_keeps_all_other_joints(viewer, page):
    before = viewer.view
    thumb = page.get_by_role("slider").first
    thumb.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    wait(page, lambda: not np.array_equal(viewer.view.q, before.q))
    viewer.settle()
    wait(page, lambda: viewer.view.q[0] > before.q[0] + np.deg2rad(0.4))
    np.testing.assert_array_equal(viewer.view.q[1:], before.q[1:])
    assert viewer.view.q[0] < before.q[0] + np.deg2rad(0.6)
    assert viewer.view.reached


def test_a_button_takes_a_solution_and_sliders_follow(viewer, page):
    other = next(slot for slot in np.flatnonzero(viewer.view.within) if slot != viewer.view.chosen)
    page.get_by_role("button", name=str(other + 1), exact=True).click()
    wait(page, lambda: viewer.view.chosen == other)
    picture(page, "chosen")
    shown = page.get_by_role("slider").first
    degrees = np.rad2deg(viewer.view.q[0])
    wait(page, lambda: abs(float(shown.get_attribute("aria-valuenow")) - degrees) < 0.06)


def test_a_ghost_that_is_clicked_is_taken(viewer, page):
    view = viewer.view
    chosen = view.chosen
    # The elbows of others, of which one at least is not behind something else.
    elbow = np.array([0.0, 0.0, 0.393, 1.0])
    for slot in np.flatnonzero(view.found):
        x, y = on_screen(viewer, (view.measures.links[slot + 1, 2] @ elbow)[:3])
        page.mouse.move(x, y)
        page.wait_for_timeout(200)
        page.mouse.click(x, y)
        page.wait_for_timeout(500)
        viewer.settle()
        if viewer.view.chosen != chosen:
            break
    assert viewer.view.chosen not in (chosen, None)
    np.testing.assert_array_equal(viewer.view.target, view.target)


def test_the_gizmo_is_dragged_and_the_arm_follows(viewer, page):
    view = viewer.view
    origin, along = view.target[:3, 3], view.target[:3, :3]
    length = 0.3 * viewer.session.shape.reach
    # Of the three arrows that which is longest on the screen.
    foot = np.array(on_screen(viewer, origin))
    tips = [np.array(on_screen(viewer, origin + 0.85 * length * axis)) for axis in along.T]
    tip = max(tips, key=lambda tip: np.linalg.norm(tip - foot))
    page.mouse.move(*tip)
    page.wait_for_timeout(300)
    page.mouse.down()
    for step in np.linspace(0, 0.4, 12):
        page.mouse.move(*(tip - step * (tip - foot)))
        page.wait_for_timeout(30)
    picture(page, "dragged")
    page.mouse.up()
    wait(page, lambda: np.linalg.norm(viewer.view.target[:3, 3] - origin) > 1e-3)
    moved = viewer.view.target[:3, 3] - origin
    index = int(np.argmax(np.abs(along.T @ moved)))
    np.testing.assert_allclose(
        np.delete(along.T @ moved, index), 0.0, atol=1e-4 + 0.02 * np.linalg.norm(moved)
    )


def test_what_is_drawn_can_be_chosen(viewer, page):
    page.get_by_role("tab", name="Show").click()
    parts = {
        "Ghosts": viewer.scene.ghosts,
        "Mobility": viewer.scene.motion,
        "Error": viewer.scene.error,
        "Capsules": viewer.scene.capsules,
    }
    for label, part in parts.items():
        before = part.visible
        page.get_by_label(label, exact=True).click()
        wait(page, lambda part=part, before=before: part.visible != before)
    page.wait_for_timeout(1500)
    picture(page, "parts")
    half = np.sort(np.asarray(viewer.scene.motion.scale))
    true = np.sqrt(np.linalg.eigvalsh(viewer.view.measures.motion))
    np.testing.assert_allclose(half / half[-1], true / true[-1], rtol=1e-5)
    for label in parts:
        page.get_by_label(label, exact=True).click()


def test_a_path_is_planned_and_taken(viewer, page):
    page.get_by_role("tab", name="Path").click()
    page.get_by_role("button", name="Best path").click()
    page.get_by_text("Add two waypoints or more first").wait_for(timeout=PATIENCE)
    first = viewer.view.target
    page.get_by_role("button", name="Add the target").click()
    page.get_by_text("Waypoints: 1").wait_for(timeout=PATIENCE)
    second = first.copy()
    second[:3, 3] += [0.0, 0.03, -0.05]
    viewer.show_target(second)
    assert viewer.settle()
    page.get_by_role("button", name="Add the target").click()
    page.get_by_text("Waypoints: 2").wait_for(timeout=PATIENCE)
    page.get_by_role("button", name="Best path").click()
    wait(page, lambda: viewer.route.route is not None)
    found = viewer.route.route
    page.get_by_text("Above the path").wait_for(timeout=PATIENCE)
    page.get_by_role("button", name="Play", exact=True).click()
    wait(page, lambda: np.allclose(viewer.view.q, found.q[found.reached - 1], atol=1e-9))
    picture(page, "path")
    page.get_by_role("button", name="Clear").click()
    wait(page, lambda: viewer.route.route is None)


@needs_pyniryo
def test_a_simulated_robot_picks_and_places(viewer, page):
    page.get_by_role("tab", name="Robot").click()
    viewer.robot.speed = 3.0
    page.get_by_role("button", name="Play the pick-and-place").click()
    page.get_by_text(re.compile(r"\d of 10")).wait_for(timeout=PATIENCE)
    picture(page, "robot")
    page.get_by_text("Done: all 10 steps").wait_for(timeout=PATIENCE)
    thing = viewer.robot.thing.position
    np.testing.assert_allclose(thing[:2], OBJECT_END[:2], atol=0.005)
    viewer.robot.speed = 0.3  # slow enough to be stopped from a slow page
    page.get_by_role("button", name="Play the pick-and-place").click()
    page.get_by_text(re.compile(r"\d of 10")).wait_for(timeout=PATIENCE)
    page.get_by_role("button", name="Stop").click()
    page.get_by_text("Stopped.").wait_for(timeout=PATIENCE)


def test_two_browsers_see_the_same_and_one_that_closes_is_not_missed(viewer, browser, page):
    other = browser.new_page(viewport=SIZE)
    other.goto(viewer.url)
    other.get_by_text("Complete: yes").wait_for(timeout=PATIENCE)
    wait(page, lambda: len(viewer.server.get_clients()) == 2)
    thumb = other.get_by_role("slider").first
    thumb.focus()
    other.keyboard.press("ArrowRight")
    said = thumb.get_attribute("aria-valuenow")
    mine = page.get_by_role("slider").first
    wait(page, lambda: mine.get_attribute("aria-valuenow") == said)
    other.close()
    wait(page, lambda: len(viewer.server.get_clients()) == 1)
    before = viewer.view.q[0]
    mine.focus()
    page.keyboard.press("ArrowLeft")
    wait(page, lambda: viewer.view.q[0] < before)


def test_errors_are_shown(viewer, page):
    viewer.show_joints(np.full(6, np.nan))
    page.get_by_text("q: expected finite numbers").wait_for(timeout=PATIENCE)
    viewer.show_joints(viewer.session.start)
    assert viewer.settle()
    assert viewer.view.reached


@needs_pyniryo
def test_the_joints_of_a_robot_are_read_also_after_it_was_lost(browser):
    robot = nj.robots.niryo_one()
    q = np.array([0.3, -0.2, 0.1, 0.2, 0.3, -0.1])
    with SimulatedNiryo(time_scale=100.0) as simulated:
        simulated.arm.move(q)
        host, port = simulated.address, simulated.port
        with Viewer(robot, host=host, port=0) as viewer:
            threading.Event().wait(1.0)
            opened = browser.new_page(viewport=SIZE)
            opened.goto(viewer.url)
            opened.get_by_role("tab", name="Robot").click(timeout=PATIENCE)
            opened.get_by_text("Reading the robot").wait_for(timeout=PATIENCE)
            wait(opened, lambda: viewer.scene.live.visible)
            opened.get_by_label("Follow it").click()
            wait(opened, lambda: np.allclose(viewer.view.q, simulated.arm.joints, atol=2e-3))
            picture(opened, "live")
            simulated.close()
            opened.get_by_text("It is tried again").wait_for(timeout=PATIENCE)
            wait(opened, lambda: not viewer.scene.live.visible)
            with SimulatedNiryo(port=port):
                opened.get_by_text("Reading the robot").wait_for(timeout=PATIENCE)
            opened.close()


def test_a_map_is_drawn_and_cut(browser):
    for module in ("xarray", "zarr", "matplotlib", "filelock"):
        pytest.importorskip(module)
    robot = nj.robots.niryo_one()
    made = nj.workspace.capability_map(robot, 0.05, orientations=8)
    with Viewer(robot, map=made, port=0) as viewer:
        opened = browser.new_page(viewport=SIZE)
        opened.goto(viewer.url)
        opened.get_by_role("tab", name="Map").click(timeout=PATIENCE)
        opened.get_by_text("voxels of 50 mm").wait_for(timeout=PATIENCE)
        opened.wait_for_timeout(3000)
        picture(opened, "map")
        opened.close()
