"""The web viewer in a real browser: Chromium of the system, driven by Playwright."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from urllib.parse import parse_qs, urlencode, urlsplit

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("playwright")

from playwright.sync_api import Browser, Page, expect, sync_playwright

from dated_passes import BRANCH, DEEP, DOWN, FIRST, MAIN, SETTLES, START, UP
from serving import serving
from trackprofile.store import Store, create, find

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip
WIDTHS = [(1280, 900), (390, 844)]
TOKEN = "a-token-of-many-letters-0123456789"

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this system")


@dataclass
class Window:
    """A browser window, its console messages, and the servers that it sent requests to."""

    page: Page
    address: str
    messages: list[str] = field(default_factory=list)
    servers: set[str] = field(default_factory=set)

    def open(self, **state: object) -> Page:
        """The page in a state, after it is drawn."""
        self.page.goto(f"{self.address}?{urlencode(state)}")
        return self.idle()

    def idle(self) -> Page:
        """The page after all requests are answered."""
        expect(self.page.locator("main")).to_have_attribute("aria-busy", "false", timeout=30_000)
        return self.page

    def state(self) -> dict[str, str]:
        """State in the address."""
        return {name: one[0] for name, one in parse_qs(urlsplit(self.page.url).query).items()}

    def span(self) -> float:
        """Length of the stretch in the address [m]."""
        return float(self.state()["to"]) - float(self.state()["from"])


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=BROWSER, args=list(FLAGS))
        yield running
        running.close()


@pytest.fixture(scope="module")
def address(dated_store: Store) -> Iterator[str]:
    with serving(dated_store) as client:
        yield str(client.base_url)


@contextmanager
def window_at(
    browser: Browser, address: str, size: tuple[int, int] = WIDTHS[0]
) -> Iterator[Window]:
    """A window whose console stays empty and which sends requests to this server only."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    window = Window(page, address)
    page.on("console", lambda one: window.messages.append(one.text))
    page.on("pageerror", lambda one: window.messages.append(str(one)))
    page.on("request", lambda one: window.servers.add(urlsplit(one.url).netloc))
    yield window
    context.close()
    assert window.messages == []
    assert window.servers <= {urlsplit(address).netloc, ""}  # the icon is a data URL


MAIN_STATE = {"line": MAIN, "direction": UP}


def test_open_choose_zoom_and_follow_a_link(browser: Browser, address: str) -> None:
    with window_at(browser, address) as window:
        page = window.open()
        page.get_by_label("Line", exact=True).select_option(MAIN)
        expect(page.locator("#charts .strip")).to_have_count(3)
        window.idle()
        assert window.state()["line"] == MAIN
        # a name with markup stays text
        assert page.locator("header b, header img, main b").count() == 0
        assert page.title().startswith("Main <b>line</b>")
        page.locator("#charts").focus()
        page.keyboard.press("+")
        page.wait_for_url(lambda url: "from=" in url)
        window.idle()
        assert window.span() == pytest.approx(3000, rel=0.01)
        page.get_by_role("link", name="Defects").click()
        window.idle()
        page.locator("#defects tbody tr").first.get_by_role("link").first.click()
        window.idle()
        assert float(window.state()["at"]) == pytest.approx(START + DEEP, abs=2)
        expect(page.locator(".reading")).to_contain_text("km 13.500")
        expect(page.locator(".reading")).to_contain_text("D1 −26")


@pytest.mark.acceptance
@pytest.mark.parametrize("size", WIDTHS, ids=str)
def test_every_view_fits_its_window_and_draws(
    browser: Browser, address: str, size: tuple[int, int]
) -> None:
    at = START + SETTLES
    with window_at(browser, address, size) as window:
        for view in ("line", "defects", "location", "compare", "quality"):
            for where in ({}, {"at": at, "from": at - 300, "to": at + 300}):
                page = window.open(view=view, **MAIN_STATE, **where)
                expect(page.locator("#message")).to_be_hidden()
                assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
                assert (
                    page.locator("header b, header img, main b, main img, main script").count() == 0
                )
                for canvas in page.locator("canvas").all():
                    assert canvas.evaluate("one => one.closest('[role=img]').ariaLabel")
                    assert canvas.evaluate(
                        "one => { const all = one.getContext('2d').getImageData(0, 0, one.width, one.height).data;"
                        " const kinds = new Set(); for (let i = 0; i < all.length; i += 4) kinds.add(all[i] << 16 |"
                        " all[i + 1] << 8 | all[i + 2]); return kinds.size > 3; }"
                    ), view


@pytest.mark.acceptance
def test_zoom_by_wheel_drag_buttons_and_keys_stays_in_the_address(
    browser: Browser, address: str
) -> None:
    with window_at(browser, address) as window:
        page = window.open(**MAIN_STATE)
        box = page.locator(".strip .u-over").first.bounding_box()
        assert box is not None
        middle = (box["x"] + box["width"] / 2, box["y"] + 80)
        page.mouse.move(*middle)
        page.mouse.wheel(0, -600)
        page.wait_for_url(lambda url: "from=" in url)
        window.idle()
        before, start = window.span(), float(window.state()["from"])
        assert before < 3000
        page.mouse.down()
        page.mouse.move(middle[0] - 300, middle[1], steps=5)
        page.mouse.up()
        page.wait_for_timeout(400)
        window.idle()
        assert window.span() == pytest.approx(before, abs=0.1)
        assert float(window.state()["from"]) > start
        for name, factor in (("zoom in", 0.5), ("zoom out", 2.0)):
            width = window.span()
            page.get_by_role("button", name=name).click()
            page.wait_for_timeout(400)
            window.idle()
            assert window.span() == pytest.approx(factor * width, rel=0.01)
        page.get_by_label("kilometre to go to").fill("15.2")
        page.keyboard.press("Enter")
        page.wait_for_url(lambda url: "at=15200" in url)
        window.idle()
        assert window.span() == pytest.approx(1000)
        page.get_by_role("button", name="whole line").click()
        page.wait_for_url(lambda url: "from=" not in url)
        window.idle()
        page.get_by_label("kilometre to go to").fill("99")
        page.keyboard.press("Enter")
        expect(page.locator("#message")).to_contain_text("Enter a kilometre from 12.000 to 18.000")


@pytest.mark.acceptance
def test_an_address_shows_the_same_to_another_reader_and_back_goes_back(
    browser: Browser, address: str
) -> None:
    with window_at(browser, address) as window:
        page = window.open(**MAIN_STATE)
        page.get_by_label("earlier date").click()
        window.idle()
        day = window.state()["day"]
        page.get_by_role("link", name="Location").click()
        window.idle()
        shared, text = page.url, page.locator("main").inner_text()
        page.go_back()
        window.idle()
        assert (window.state()["view"], window.state()["day"]) == ("line", day)
        page.go_back()
        window.idle()
        assert window.state()["day"] > day
        page.go_forward()
        page.go_forward()
        window.idle()
        assert page.url == shared
        with window_at(browser, address) as other:
            other.page.goto(shared)
            assert other.idle().locator("main").inner_text() == text


@pytest.mark.acceptance
def test_two_dates_are_compared_and_a_change_is_followed_over_time(
    browser: Browser, address: str
) -> None:
    with window_at(browser, address) as window:
        page = window.open(view="compare", **MAIN_STATE, band="D1")
        page.get_by_label("Compare with").select_option(str(FIRST))
        window.idle()
        assert window.state()["compared_day"] == str(FIRST)
        row = page.locator("#changes tbody tr").first
        expect(row).to_contain_text(f"km {(START + SETTLES) / 1000:.3f}")
        row.get_by_role("link", name="development").click()
        window.idle()
        expect(page.locator("h1")).to_contain_text(
            f"Development at km {(START + SETTLES) / 1000:.3f}"
        )
        expect(page.locator(".first")).to_contain_text("The height increases by 1.")
        expect(page.locator(".first")).to_contain_text("If the trend continues, ")
        expect(page.locator("#passes tbody tr")).to_have_count(4)
        page.get_by_label("Passes since").select_option(index=1)
        window.idle()
        expect(page.locator("#passes tbody tr")).to_have_count(3)
        page.get_by_role("button", name="1 m forward").click()
        window.idle()
        assert float(window.state()["at"]) == pytest.approx(START + SETTLES + 1, abs=0.5)


@pytest.mark.acceptance
def test_data_quality_shows_gaps_flags_and_origin(browser: Browser, address: str) -> None:
    with window_at(browser, address) as window:
        page = window.open(view="quality", **MAIN_STATE)
        expect(page.locator("#quality tbody tr")).to_have_count(4)
        expect(page.locator("#quality")).to_contain_text("gap 1.3 %, edge 0.3 %, slow 2.0 %")
        expect(page.locator(".day.has")).to_have_count(4)
        expect(page.locator("dl.origin")).to_contain_text("<i>06:12</i>")
        page.locator(".day.has").first.click()
        window.idle()
        assert window.state()["day"] == str(FIRST)
        box = page.locator("canvas.coverage").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 10)
        expect(page.locator(".reading")).to_contain_text(re.compile(r"km 1\d\.\d: ± 0\.\d+ mm"))


@pytest.mark.acceptance
def test_passes_of_one_day_are_shown_together_or_one_by_one(
    browser: Browser, address: str, dated_store: Store
) -> None:
    with window_at(browser, address) as window:
        page = window.open(line=BRANCH, direction=DOWN)
        choice = page.get_by_label("Pass", exact=True)
        expect(choice.locator("option")).to_have_count(3)
        expect(choice.locator("option").nth(1)).to_contain_text("coach <script>1</script>")
        late = find(dated_store, line=BRANCH)[1].id
        choice.select_option(late)
        window.idle()
        assert window.state()["entry"] == late
        page.get_by_role("link", name="Two dates").click()
        expect(page.locator("main")).to_contain_text("passes of one date only")
        page.get_by_label("Line", exact=True).select_option(MAIN)
        window.idle()
        expect(page.locator(".strip canvas")).to_have_count(2)


@pytest.mark.acceptance
def test_everything_is_reached_by_keyboard(browser: Browser, address: str) -> None:
    with window_at(browser, address) as window:
        page = window.open(view="defects", **MAIN_STATE)
        reached = []
        for _ in range(40):
            page.keyboard.press("Tab")
            reached.append(page.evaluate("document.activeElement.textContent.slice(0, 30)"))
            outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
            assert outline != "none"
            if reached[-1].startswith("km 13.500"):
                break
        assert reached[0].startswith("Skip to the charts")
        assert any(one.startswith("Two dates") for one in reached)
        page.keyboard.press("Enter")
        window.idle()
        assert window.state()["view"] == "line"
        page.locator("#charts").focus()
        for key, changes in [
            *((key, True) for key in ("ArrowRight", "PageDown", "-", "Home")),
            ("a", False),
        ]:
            before = page.url
            page.keyboard.press(key)
            page.wait_for_timeout(450)
            window.idle()
            assert (page.url != before) is changes, key


@pytest.mark.acceptance
def test_an_unknown_line_in_the_address_is_reported(browser: Browser, address: str) -> None:
    with window_at(browser, address) as window:
        window.page.goto(
            f"{address}?line=none&direction=<img src=x>&view=<script>&from=nan&at=1e999"
        )
        message = window.page.locator("#message")
        expect(message).to_contain_text("The store contains no line “none”")
        window.page.get_by_label("Line", exact=True).select_option(BRANCH)
        expect(message).to_be_hidden()
        window.idle()


@pytest.mark.acceptance
def test_an_empty_store_shows_how_to_add_a_pass(browser: Browser, tmp_path) -> None:
    store = create(str(tmp_path / "empty"))
    with serving(store) as client, window_at(browser, str(client.base_url)) as window:
        expect(window.open().locator("main")).to_contain_text("trackprofile store add")


@pytest.mark.acceptance
def test_the_login_keeps_a_shared_address(browser: Browser, dated_store: Store) -> None:
    with serving(dated_store, TOKEN) as client, window_at(browser, str(client.base_url)) as window:
        page = window.page
        page.goto(f"{window.address}?{urlencode({'view': 'defects', **MAIN_STATE})}")
        page.get_by_label("Token").fill("wrong")
        page.keyboard.press("Enter")
        expect(page.locator(".error")).to_contain_text("The token is wrong")
        page.get_by_label("Token").fill(TOKEN)
        page.keyboard.press("Enter")
        expect(page.locator("#defects tbody tr").first).to_be_visible()
        assert window.state()["view"] == "defects"
        assert TOKEN not in page.url
        (cookie,) = page.context.cookies()
        assert (cookie.get("httpOnly"), cookie.get("sameSite")) == (True, "Strict")
        assert page.evaluate("document.cookie") == ""
        page.get_by_role("button", name="Log out").click()
        expect(page.get_by_label("Token")).to_be_visible()
        window.messages[:] = [
            one for one in window.messages if "401" not in one
        ]  # a message of the browser
