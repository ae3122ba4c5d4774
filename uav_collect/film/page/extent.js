// What part of the area the maps show: all that matters, or nearer by wheel, keys and buttons.

const RIM = 0.02; // about the map, of its longer side
const WIDE = 2.5; // times as wide as high: such a map gets the whole width of the page
const NEAREST = 32; // times as near as the whole
const NEARER = 1.25; // by one turn of the wheel

/** A box that holds nothing yet: west, south, east, north [m]. */
const noBox = () => [Infinity, Infinity, -Infinity, -Infinity];

function stretch(box_m, [west_m, south_m, east_m, north_m]) {
  box_m[0] = Math.min(box_m[0], west_m);
  box_m[1] = Math.min(box_m[1], south_m);
  box_m[2] = Math.max(box_m[2], east_m);
  box_m[3] = Math.max(box_m[3], north_m);
}

/** Where data may wait, all outlines, and where UAVs start and land. */
function placesOf({ area, uavs }) {
  const { rows, columns, cell_size_m: size_m } = area;
  const bare = new Set([...area.outside, ...area.closed, ...area.known_empty]);
  const box_m = noBox();
  for (let cell = 0; cell < rows * columns; cell += 1) {
    if (bare.has(cell)) continue;
    const [x_m, y_m] = [(cell % columns) * size_m, Math.floor(cell / columns) * size_m];
    stretch(box_m, [x_m, y_m, x_m + size_m, y_m + size_m]);
  }
  if (area.outlines_m) stretch(box_m, area.outlines_m);
  for (const [x_m, y_m] of uavs.flatMap(({ start_m, home_m }) => [start_m, home_m])) {
    const half_m = size_m / 2;
    stretch(box_m, [x_m - half_m, y_m - half_m, x_m + half_m, y_m + half_m]);
  }
  return box_m;
}

/** The same for all maps of a film. North is up: y of a picture falls from the area's north. */
class Extent {
  constructor(film, flights) {
    this.height_m = film.area.rows * film.area.cell_size_m;
    this.half_m = film.area.cell_size_m / 2;
    this.flights = flights;
    this.places_m = placesOf(film);
    this.nearness = 1;
    this.fit();
  }

  /** Hold all that the flights have come to, besides the places that are known. */
  fit() {
    const box_m = [...this.places_m];
    for (const { box_m: [west_m, south_m, east_m, north_m] } of this.flights) {
      stretch(box_m, [west_m - this.half_m, south_m - this.half_m,
        east_m + this.half_m, north_m + this.half_m]);
    }
    const [west_m, south_m, east_m, north_m] = box_m;
    const [width_m, high_m] = [east_m - west_m, north_m - south_m];
    const rim_m = Math.max(width_m, high_m) * RIM;
    this.whole = [west_m - rim_m, this.height_m - north_m - rim_m,
      width_m + 2 * rim_m, high_m + 2 * rim_m];
    if (this.nearness === 1) this.showAll();
  }

  showAll() {
    const [x, y, width, height] = this.whole;
    this.nearness = 1;
    this.middle = [x + width / 2, y + height / 2];
  }

  get aspect() {
    return this.whole[2] / this.whole[3];
  }

  /** The part that is shown, as the viewBox of a picture. */
  get box() {
    const [width, height] = [this.whole[2] / this.nearness, this.whole[3] / this.nearness];
    return [this.middle[0] - width / 2, this.middle[1] - height / 2, width, height];
  }

  /** Come nearer by a factor, or go farther by one below 1, while a place stays where it is. */
  approach(factor, place = this.middle) {
    const nearness = Math.max(1, Math.min(NEAREST, this.nearness * factor));
    const left = this.nearness / nearness;
    this.moveTo(this.middle.map((middle, k) => place[k] + (middle - place[k]) * left), nearness);
  }

  /** Show a place in the middle, as far as the whole reaches. */
  moveTo(middle, nearness = this.nearness) {
    this.nearness = nearness;
    this.middle = middle.map((value, k) => {
      const [low, side] = [this.whole[k], this.whole[k + 2]];
      const half = side / nearness / 2;
      return Math.max(low + half, Math.min(low + side - half, value));
    });
  }
}

/** Let a picture be looked at from near by the wheel, and be drawn about by a pointer. */
function makeNear(svg, extent, onChange) {
  const placeOf = ({ clientX, clientY }) => {
    const place = new DOMPoint(clientX, clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [place.x, place.y];
  };
  let held = null; // the place under the pointer that draws
  svg.addEventListener('wheel', (event) => {
    event.preventDefault();
    extent.approach(event.deltaY < 0 ? NEARER : 1 / NEARER, placeOf(event));
    onChange();
  }, { passive: false });
  svg.addEventListener('pointerdown', (event) => {
    if (extent.nearness === 1 || event.button !== 0) return;
    held = placeOf(event);
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener('pointermove', (event) => {
    if (!held) return;
    const [x, y] = placeOf(event);
    extent.moveTo([extent.middle[0] + held[0] - x, extent.middle[1] + held[1] - y]);
    onChange();
  });
  for (const end of ['pointerup', 'pointercancel']) svg.addEventListener(end, () => { held = null; });
}
