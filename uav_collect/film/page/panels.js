// What stands beside the map: figures, a card for each UAV, flights to compare, sensors.

/** An HTML element with its properties and children; text is never markup. */
function node(name, properties = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key in element) element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

const byId = (id) => document.getElementById(id);

function badgeOf(uav, id) {
  const badge = node('span', { className: 'badge' }, String(id));
  badge.style.backgroundColor = colourOf(uav);
  badge.style.color = inkOn(uav);
  return badge;
}

/** A number with its name, in the list of totals. */
class Total {
  constructor(list, name, key) {
    this.value = node('dd', { id: `total-${key}` });
    list.append(node('div', {}, node('dt', {}, name), this.value));
  }

  set(text) {
    if (this.value.textContent !== text) this.value.textContent = text;
  }
}

class Totals {
  constructor(film, flight) {
    this.film = film;
    this.flight = flight;
    const list = byId('totals');
    this.data = new Total(list, 'Data', 'data');
    this.share = new Total(list, 'Share', 'share');
    this.energy = new Total(list, 'Energy', 'energy');
    this.efficiency = new Total(list, 'Efficiency', 'efficiency');
  }

  draw(time_s) {
    const bit = this.flight.collectedAt(time_s);
    const joule = this.flight.energyUsedAt(time_s);
    const share = this.film.total_bit > 0 ? bit / this.film.total_bit : 1;
    const digits = this.film.total_bit < 1e8 ? 2 : 1;
    this.data.set(`${(bit / 1e6).toFixed(digits)} of `
      + `${(this.film.total_bit / 1e6).toFixed(digits)} Mbit`);
    this.share.set(percent(share));
    this.energy.set(kilojoule(joule));
    this.efficiency.set(joule > 0 ? `${(bit / joule / 1e3).toFixed(3)} kbit/J` : '–');
  }
}

/** One UAV: what it does, its energy, what it has collected and knows, what it reads now. */
class Card {
  constructor(film, flight, uav, place, choose) {
    this.film = film;
    this.flight = flight;
    this.uav = uav;
    this.about = film.uavs[uav];
    this.deed = node('p', { className: 'deed' });
    this.energyText = node('span');
    this.energy = node('span', { className: 'fill' });
    this.meter = node('div', {
      className: 'meter', role: 'meter', 'aria-valuemin': 0,
      'aria-valuemax': Math.round(this.about.budget_j / 1e3),
      'aria-label': `Energy of UAV ${this.about.id} in kilojoule`,
    }, this.energy);
    const margin = node('span', { className: 'margin', title: 'margin to be left when home' });
    margin.style.left = percent(this.about.margin_j / this.about.budget_j);
    if (this.about.margin_j > 0) this.meter.append(margin);
    this.facts = node('p', { className: 'facts' });
    this.reads = node('ul', { className: 'reads' });
    this.button = node('button', { type: 'button', title: `show what it knows (${uav + 1})` },
      'Its map');
    this.button.disabled = !flight.knows;
    this.button.addEventListener('click', () => choose(uav));
    const isAlike = film.uavs.every(({ policy }) => policy === this.about.policy);
    this.element = node('article', { 'aria-label': `UAV ${this.about.id}` },
      node('header', {}, badgeOf(uav, this.about.id), node('h2', {}, `UAV ${this.about.id}`),
        node('span', { className: 'by' }, isAlike ? '' : this.about.policy), this.button),
      this.deed,
      node('div', { className: 'energy' }, this.meter, this.energyText), this.facts, this.reads);
    this.element.dataset.uav = uav + 1;
    place.append(this.element);
  }

  draw(state, time_s, isChosen) {
    const { about } = this;
    const share = Math.max(0, state.energy_j / about.budget_j);
    this.energy.style.width = `${(share * 100).toFixed(1)}%`;
    this.meter.setAttribute('aria-valuenow', Math.round(state.energy_j / 1e3));
    this.meter.dataset.joule = state.energy_j;
    this.energyText.textContent = `${kilojoule(state.energy_j)} (${percent(share)})`;
    this.deed.textContent = this.deedOf(state, time_s);
    const known = state.leg ? `, ${this.knownIn(state)}` : '';
    this.facts.textContent = `${mbit(state.collected_bit)} collected${known}`;
    this.button.setAttribute('aria-pressed', isChosen);
    this.element.classList.toggle('chosen', isChosen);
    this.drawReads(state, time_s);
  }

  deedOf(state, time_s) {
    const faults = this.flight.faultsOf(this.uav, time_s);
    const fault = faults.length ? ` (fault: ${faults.join(', ')})` : '';
    if (!state.leg) return `waits to start${fault}`;
    const { event } = state.leg;
    const why = event.reason === 'fault' ? fault : `: ${event.reason}${fault}`;
    if (state.is_home) return `landed at ${seconds(state.leg.end_s)}${why}`;
    if (state.leg.action === HOME) return `flies home${why}`;
    if (state.share >= 1) return `waits${fault}`;
    const by = event.reason === 'policy' ? '' : `, by its ${event.reason}`;
    return `${ACTIONS[state.leg.action]}${by}${fault}`;
  }

  knownIn(state) {
    const { area } = this.film;
    const n_closed = area.closed.length + area.outside.length; // which count as complete
    const n_known = state.leg.event.known_complete - n_closed;
    return `knows ${n_known} of ${area.rows * area.columns - n_closed} cells complete`;
  }

  /** The sensors that are read now: rate, share of the bandwidth, how far. */
  drawReads(state, time_s) {
    const leg = state.leg && state.leg.action === HOVER && state.share < 1 ? state.leg : null;
    if (this.leg !== leg) {
      this.leg = leg;
      this.bars = (leg ? leg.reads : []).map((read) => {
        const bar = node('span', { className: 'fill' });
        const share = read.share ? `, ${percent(read.share)} of the band` : '';
        const text = `${rate(read.bps)}${share}`;
        const { id } = this.film.sensors[read.sensor];
        return { read, bar, item: node('li', {}, bar, node('b', {}, id), ` ${text}`) };
      });
      this.reads.replaceChildren(...this.bars.map(({ item }) => item));
    }
    for (const { read, bar } of this.bars || []) {
      const done = (time_s - read.start_s) / Math.max(read.end_s - read.start_s, 1e-9);
      bar.style.width = `${Math.min(100, Math.max(0, done * 100))}%`;
    }
  }
}

/** Flights to compare: the film's own, and its ghosts with what each has by now. */
class FlightTable {
  constructor(flights, onChange) {
    this.rows = flights.map((flight, k) => {
      const cells = { data: node('td'), end: node('td'), energy: node('td') };
      const boxes = ['over', 'beside'].map((way) => {
        const box = node('input', { type: 'checkbox', id: `${way}-${k}` });
        box.setAttribute('aria-label', `${flight.name}, ${way} the map`);
        box.addEventListener('change', () => onChange());
        return box;
      });
      const isOwn = k === 0;
      const name = node('th', { scope: 'row' }, isOwn ? 'this mission' : flight.name);
      const mark = node('span', { className: `mark m${k}` });
      name.prepend(mark);
      const toggles = boxes.map((box) => node('td', {}, ...(isOwn ? [] : [box])));
      const row = node('tr', {}, name, cells.data, cells.energy, cells.end, ...toggles);
      return { flight, cells, boxes, row, mark: flight.name[0].toUpperCase() };
    });
    const head = ['', 'Mbit', 'kJ', 'ends at s', 'over', 'beside']
      .map((word) => node('th', { scope: 'col' }, word));
    byId('flights').append(node('table', {},
      node('caption', {}, 'Same mission, same clock'),
      node('thead', {}, node('tr', {}, ...head)),
      node('tbody', {}, ...this.rows.map(({ row }) => row))));
  }

  chosen(way) {
    const place = way === 'over' ? 0 : 1;
    return this.rows.filter(({ boxes }, k) => k > 0 && boxes[place].checked);
  }

  draw(time_s) {
    for (const { flight, cells } of this.rows) {
      cells.data.textContent = (flight.collectedAt(time_s) / 1e6).toFixed(2);
      cells.energy.textContent = (flight.energyUsedAt(time_s) / 1e3).toFixed(1);
      cells.end.textContent = flight.isOver ? flight.end_s.toFixed(1) : 'not over';
    }
  }
}

const MOST_ROWS = 1000; // of the table of sensors

/** Sensors that hold data: when each was read, by whom, how fast. */
class SensorTable {
  constructor(film, flight, seek) {
    this.film = film;
    this.flight = flight;
    this.seek = seek;
    this.filter = node('input', { type: 'search', placeholder: 'find a sensor' });
    this.filter.setAttribute('aria-label', 'Find a sensor by its name');
    this.filter.addEventListener('input', () => this.fill());
    this.body = node('tbody');
    this.more = node('p', { className: 'more' });
    const head = ['Sensor', 'Mbit', 'Read at s', 'By', 'Mbit/s', 'Band']
      .map((word) => node('th', { scope: 'col' }, word));
    this.box = node('div', {
      className: 'rows', tabIndex: 0, role: 'region', 'aria-label': 'Sensors',
    }, node('table', {}, node('thead', {}, node('tr', {}, ...head)), this.body));
    byId('sensors').append(
      node('header', {}, node('h2', {}, 'Sensors'), this.filter),
      this.box, this.more);
    this.fill();
  }

  /** Show whole rows alone: half a one at the foot looks as if it were the last. */
  fit() {
    this.box.style.maxHeight = '';
    const [first] = this.rows;
    if (!first) return;
    const head = first.row.offsetTop;
    const n_rows = Math.max(1, Math.floor((this.box.clientHeight - head) / first.row.offsetHeight));
    this.box.style.maxHeight = `${head + n_rows * first.row.offsetHeight}px`;
  }

  fill() {
    const wanted = this.filter.value.trim().toLowerCase();
    const found = this.film.sensors.map((sensor, k) => ({ sensor, k }))
      .filter(({ sensor }) => sensor.bit > 0 && sensor.id.toLowerCase().includes(wanted));
    const read_s = ({ k }) => (this.flight.readings.get(k) || { start_s: Infinity }).start_s;
    found.sort((a, b) => (read_s(a) - read_s(b)) || a.k - b.k);
    this.rows = found.slice(0, MOST_ROWS).map((each) => this.rowOf(each));
    this.body.replaceChildren(...this.rows.map(({ row }) => row));
    const n_more = found.length - this.rows.length;
    const none = found.length ? '' : 'no sensor with data';
    this.more.textContent = n_more > 0 ? `${n_more} more: narrow the search` : none;
  }

  rowOf({ sensor, k }) {
    const read = this.flight.readings.get(k);
    const cells = [sensor.id, (sensor.bit / 1e6).toFixed(2)];
    if (read) {
      cells.push(read.start_s.toFixed(1), '', read.bps ? (read.bps / 1e6).toFixed(2) : '?',
        read.share ? percent(read.share) : '?');
    } else {
      cells.push('not read', '', '', '');
    }
    const row = node('tr', {}, ...cells.map((text) => node('td', {}, text)));
    if (read) {
      row.children[3].append(badgeOf(read.uav, this.film.uavs[read.uav].id));
      const go = node('button', { type: 'button', className: 'go' }, cells[2]);
      go.title = `go to ${cells[2]} s`;
      go.addEventListener('click', () => this.seek(read.start_s));
      row.children[2].replaceChildren(go);
    }
    return { row, read };
  }

  draw(time_s) {
    for (const { row, read } of this.rows) {
      const state = !read || time_s < read.start_s ? '' : (time_s < read.end_s ? 'now' : 'past');
      if (row.className !== state) row.className = state;
    }
  }
}

/** What the signs of the map mean. */
function drawLegend(film) {
  const sign = (name, attributes) => {
    const picture = shape('svg', { viewBox: '-8 -8 16 16', 'aria-hidden': true });
    picture.append(shape(name, attributes));
    return picture;
  };
  const message = sign('line', { x1: -8, x2: 8, class: 'message' });
  message.append(shape('circle', { cx: 2, r: 3.5, class: 'message' }));
  const entries = [
    [sign('circle', { r: 4, class: 'waiting' }), 'data waits'],
    [sign('circle', { r: 5, class: 'reading' }), 'being read'],
    [sign('circle', { r: 4, class: 'read' }), 'read'],
    [sign('circle', { r: 4, class: 'left' }), 'left behind'],
    [sign('circle', { r: 2, class: 'empty' }), 'no data'],
    [sign('rect', { x: -6, y: -6, width: 12, height: 12, class: 'data', 'fill-opacity': 0.5 }),
      'cell with data'],
    [sign('rect', { x: -6, y: -6, width: 12, height: 12, class: 'known-sign' }),
      'known complete'],
    [sign('line', { x1: -8, x2: 8, class: 'contact' }), 'in radio contact'],
    [message, 'message, on its way'],
    [sign('path', { d: 'M-7 0L0 -7L7 0V6H-7z', class: 'home-sign' }), 'start, home'],
  ];
  if (film.area.known_empty.length) {
    entries.push([sign('rect', { x: -6, y: -6, width: 12, height: 12, class: 'bare' }),
      'no sensor, as all know']);
  }
  if (film.area.closed.length + film.area.outside.length) {
    entries.push([sign('rect', { x: -6, y: -6, width: 12, height: 12, class: 'closed-sign' }),
      'closed cell']);
  }
  if (film.area.no_fly.length) {
    entries.push([sign('rect', { x: -6, y: -5, width: 12, height: 10, class: 'no-fly' }),
      'no-fly zone']);
  }
  if (film.area.boundary) {
    entries.push([sign('line', { x1: -8, x2: 8, class: 'boundary' }), "area's edge"]);
  }
  byId('legend').append(...entries.map(([picture, text]) => node('li', {}, picture, text)));
}
