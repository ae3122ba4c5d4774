"""Pages of films for tests in a browser: made, shown, and held against their log."""

from pathlib import Path

from browser import Page, Watched
import pytest
from uav_collect.analysis.legs import mission_legs, state_at
from uav_collect.analysis.results import flown_mission, FlownMission
from uav_collect.film.mission_page import mission_page
from uav_collect.missions import rollout
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site

LAPTOP = {'width': 1366, 'height': 768}
PHONE = {'width': 390, 'height': 844}

_SHOWN = """() => {
  const scale = film.map.px;
  const ground = document.querySelector('.map .area').getBoundingClientRect();
  return {
    data: document.getElementById('total-data').textContent,
    uavs: [...document.querySelectorAll('.map .uav')].map((badge, k) => {
      const disc = badge.querySelector('circle').getBoundingClientRect();
      return {
        place_m: [Number(badge.dataset.x), Number(badge.dataset.y)],
        drawn_m: [
          ((disc.left + disc.right) / 2 - ground.left) * scale,
          (ground.bottom - (disc.top + disc.bottom) / 2) * scale,
        ],
        energy_j: Number(document.querySelectorAll('.meter')[k].dataset.joule),
      };
    }),
  };
}"""


def flown(scenario: Scenario, policy: str = 'hert', seed: int = 0) -> FlownMission:
    """A mission of a scenario."""
    site = build_site(scenario)
    [log] = rollout.fly(site, [seed], policy)
    return flown_mission(log, site)


def show(screen: Watched, film: Path, size: dict[str, int] = LAPTOP, **media: str) -> None:
    """Show a film anew."""
    screen.page.set_viewport_size(size)
    screen.page.emulate_media(
        **({'color_scheme': 'light', 'reduced_motion': 'no-preference'} | media)
    )
    screen.requests.clear()
    screen.page.goto(film.as_uri())
    screen.wait_until('window.film !== undefined')


def check_silence(screen: Watched, film: Path) -> None:
    """The page has asked for nothing but itself, and found nothing wrong."""
    requests = {url for url in screen.requests if not url.startswith('data:')}
    assert requests == {film.as_uri()}
    assert screen.errors == []


def written(folder: Path, mission: FlownMission) -> Path:
    """The film of a mission, as a file in a folder."""
    file = folder / 'film.html'
    file.write_bytes(mission_page(mission, None))
    return file


def seek(page: Page, time_s: float) -> None:
    """Show a time of the mission."""
    page.evaluate('(time_s) => film.seek(time_s)', time_s)


def check_places(page: Page, mission: FlownMission) -> None:
    """Places, energies and data on the page are those of the log, at ten times."""
    legs = mission_legs(mission.log, mission.site.scenario)
    end_s = mission.metrics.completion_s
    for time_s in [end_s * number / 9 for number in range(10)]:
        seek(page, time_s)
        shown = page.evaluate(_SHOWN)
        for own, uav in zip(legs, shown['uavs'], strict=True):
            state = state_at(own, time_s)
            assert uav['place_m'] == pytest.approx(state.place_m, abs=1e-6)
            assert uav['energy_j'] == pytest.approx(state.energy_left_j, abs=1e-6)
            # It is drawn there, or beside another one.
            assert uav['drawn_m'] == pytest.approx(state.place_m, abs=20.0)
        data_mbit = float(shown['data'].split()[0])
        assert data_mbit == pytest.approx(collected_bit(mission, time_s) / 1e6, abs=0.006)


def collected_bit(mission: FlownMission, time_s: float) -> float:
    """What hovers have read by a time, by rates."""
    return sum(
        min(max(time_s - it.start_s, 0.0) * it.rate_bps, it.data_bit) for it in mission.readings
    )
