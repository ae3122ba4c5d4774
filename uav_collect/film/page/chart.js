// Data over time, and the strip of what each UAV does when.

const MOST_TIMES = 2.5; // the mission's own length, up to which ghosts are drawn
const FLIGHT_DASHES = ['', '7 3', '2 3', '9 3 2 3'];

/** About so many round values from 0 to the most. */
function ticks(most, about) {
  const rough = most / about;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((it) => it * power).find((it) => it >= rough);
  const values = [];
  for (let value = 0; value <= most * 1.0001; value += step) values.push(value);
  return values;
}

class Chart {
  constructor(film, flights, seek) {
    this.film = film;
    this.flights = flights;
    this.svg = shape('svg', { role: 'img', 'aria-label': 'Data collected over time' });
    byId('chart').append(node('figcaption', {}, 'Data collected [Mbit] over time [s]'), this.svg);
    this.svg.addEventListener('click', (event) => {
      const left = event.clientX - this.svg.getBoundingClientRect().left;
      seek(Math.max(0, (left - this.left) / this.scale));
    });
  }

  /** Draw all but the mark of the time. */
  build() {
    const { clientWidth: width, clientHeight: height } = this.svg;
    if (!width) return;
    const [right, top, bottom] = [8, 6, 18];
    this.left = 34;
    const last_s = Math.max(...this.flights.map((flight) => flight.end_s), 1);
    const own_s = this.flights[0].end_s;
    const end_s = own_s > 0 ? Math.min(last_s, MOST_TIMES * own_s) : last_s;
    const most = this.film.total_bit || 1e6;
    this.scale = (width - this.left - right) / end_s;
    const high = height - top - bottom;
    this.x = (time_s) => this.left + time_s * this.scale;
    this.y = (bit) => top + high * (1 - bit / most);
    const parts = [];
    for (const bit of ticks(most / 1e6, 4)) {
      const y = this.y(bit * 1e6);
      parts.push(shape('path', { class: 'rule', d: `M${this.left} ${y}H${width - right}` }));
      parts.push(shape('text', { x: this.left - 4, y: y + 3, class: 'value' }, +bit.toFixed(6)));
    }
    for (const time_s of ticks(end_s, Math.max(2, Math.floor(width / 90)))) {
      parts.push(shape('text', { x: this.x(time_s), y: height - 4, class: 'time' }, time_s));
    }
    this.flights.forEach((flight, k) => {
      const points = flight.bends().map(
        (time_s) => `${this.x(time_s).toFixed(1)} ${this.y(flight.collectedAt(time_s)).toFixed(1)}`,
      );
      const line = shape('path', {
        class: `line m${k}`, d: `M${points.join('L')}`, 'stroke-dasharray': FLIGHT_DASHES[k % 4],
      });
      line.append(shape('title', {}, k === 0 ? 'this mission' : flight.name));
      parts.push(line);
    });
    this.cursor = shape('path', { class: 'cursor' });
    this.spot = shape('circle', { class: 'spot', r: 4 });
    this.bottom = top + high;
    this.svg.replaceChildren(...parts, this.cursor, this.spot);
  }

  draw(time_s) {
    if (!this.cursor) return;
    const x = this.x(Math.min(time_s, this.flights[0].end_s));
    this.cursor.setAttribute('d', `M${this.x(time_s)} 4V${this.bottom}`);
    put(this.spot, { cx: x, cy: this.y(this.flights[0].collectedAt(time_s)) });
  }
}

/** Legs on the strip, as the path of a line; what follows nearer than can be seen is one piece. */
function pieces(legs, isChosen, x, y) {
  const ends = [];
  for (const leg of legs) {
    if (!isChosen(leg)) continue;
    const start = x(leg.start_s);
    if (ends.length && start - ends[ends.length - 1][1] < 0.3) ends[ends.length - 1][1] = x(leg.end_s);
    else ends.push([start, x(leg.end_s)]);
  }
  return ends.map(([start, end]) => `M${start} ${y}H${end}`).join('');
}

/** A row for each UAV: hovers thick, moves thin, the way home dotted. */
function drawStrip(film, flight, end_s) {
  const strip = byId('strip');
  const n_uavs = film.uavs.length;
  const row = Math.max(1.5, Math.min(7, 42 / n_uavs));
  put(strip, { viewBox: `0 0 1000 ${row * n_uavs}`, preserveAspectRatio: 'none' });
  strip.style.height = `${row * n_uavs}px`;
  const x = (time_s) => (1000 * time_s) / (end_s || 1);
  strip.replaceChildren(...flight.ways.map(({ legs }, uav) => {
    const y = row * (uav + 0.5);
    const group = shape('g', { stroke: colourOf(uav) });
    for (const [name, isChosen, width] of [
      ['moves', (leg) => leg.action !== HOVER && leg.action !== HOME, 0.18],
      ['hovers', (leg) => leg.action === HOVER, 0.8],
      ['home', (leg) => leg.action === HOME, 0.35],
    ]) {
      const d = pieces(legs, isChosen, x, y);
      group.append(shape('path', { class: name, d, 'stroke-width': row * width }));
    }
    return group;
  }));
}
