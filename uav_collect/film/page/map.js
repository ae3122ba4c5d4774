// The map of one flight: what stays is drawn once, what moves at every frame.

const SVG = 'http://www.w3.org/2000/svg';
const N_COLOURS = 8; // of UAVs; those after them have dashed trails
const MOST_NAMES = 60; // sensors whose names find room on the map
const MOST_LEGS = 3000; // of a trail, the latest

const colourOf = (uav) => `var(--uav-${uav % N_COLOURS})`;
const inkOn = (uav) => `var(--on-${uav % N_COLOURS})`;

/** An SVG element with its attributes, and text that is never markup. */
function shape(name, attributes = {}, text = null) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== null) element.textContent = text;
  return element;
}

function put(element, attributes) {
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
}

class FlightMap {
  constructor(film, flight, place, label, extent) {
    this.extent = extent;
    this.film = film;
    this.flight = flight;
    this.isNamed = film.sensors.length <= MOST_NAMES;
    const { area } = film;
    this.width_m = area.columns * area.cell_size_m;
    this.height_m = area.rows * area.cell_size_m;
    this.svg = shape('svg', { role: 'img', 'aria-label': label });
    place.append(this.svg);
    this.noCells = new Set([...area.outside, ...area.closed]);
    this.shown = {}; // what was drawn last, to leave alone what has not changed
    this.drawGround();
    this.layers = {};
    for (const name of ['trails', 'contacts', 'hovers', 'ghosts', 'uavs']) {
      this.layers[name] = this.svg.appendChild(shape('g', { class: name }));
    }
    this.makeUavs();
    this.fit();
  }

  /** North is up: y of the picture for y of the area. */
  up(y_m) {
    return this.height_m - y_m;
  }

  squares(cells) {
    const { columns, cell_size_m: size_m } = this.film.area;
    return cells.map((cell) => {
      const [x_m, y_m] = [(cell % columns) * size_m, Math.floor(cell / columns) * size_m];
      return `M${x_m} ${this.up(y_m)}h${size_m}v${-size_m}h${-size_m}z`;
    }).join('');
  }

  outline(points) {
    return `M${points.map(([x_m, y_m]) => `${x_m} ${this.up(y_m)}`).join('L')}z`;
  }

  drawGround() {
    const { area, sensors } = this.film;
    const size_m = area.cell_size_m;
    const ground = this.svg.appendChild(shape('g', { class: 'ground' }));
    ground.append(this.patterns());
    ground.append(shape('rect', { class: 'area', width: this.width_m, height: this.height_m }));
    const key = this.flight.name.replace(/\W/g, '');
    this.known = ground.appendChild(shape('path', { class: 'known', fill: `url(#known-${key})` }));
    this.drawWaiting(ground);
    let grid = '';
    for (let k = 0; k <= area.columns; k += 1) grid += `M${k * size_m} 0V${this.height_m}`;
    for (let k = 0; k <= area.rows; k += 1) grid += `M0 ${k * size_m}H${this.width_m}`;
    ground.append(shape('path', { class: 'grid', d: grid }));
    ground.append(shape('path', {
      class: 'closed', d: this.squares(area.closed), fill: `url(#closed-${key})`,
    }));
    ground.append(shape('path', { class: 'bare', d: this.squares(area.known_empty) }));
    ground.append(shape('path', { class: 'outside', d: this.squares(area.outside) }));
    ground.append(shape('path', {
      class: 'beyond', d: this.squares(area.outside), fill: `url(#closed-${key})`,
    }));
    for (const points of area.no_fly) {
      const zone = ground.appendChild(shape('path', { class: 'no-fly', d: this.outline(points) }));
      zone.append(shape('title', {}, 'no-fly zone'));
    }
    if (area.boundary) {
      ground.append(shape('path', { class: 'boundary', d: this.outline(area.boundary) }));
    }
    this.drawHomes(ground);
    this.dots = sensors.map((sensor) => {
      const dot = ground.appendChild(shape('circle', {
        cx: sensor.x_m, cy: this.up(sensor.y_m), class: sensor.bit > 0 ? 'waiting' : 'empty',
      }));
      const about = sensor.bit > 0 ? mbit(sensor.bit) : 'no data';
      dot.append(shape('title', {}, `${sensor.id}: ${about}`));
      return dot;
    });
    this.names = sensors.map((sensor) => shape('text', { class: 'name' }, sensor.id));
    this.nameLayer = ground.appendChild(shape('g'));
    this.nameLayer.append(...(this.isNamed ? this.names : []));
  }

  patterns() {
    const widest_m = Math.max(this.extent.whole[2], this.extent.whole[3]);
    const step = Math.max(this.film.area.cell_size_m / 4, widest_m / 50); // to be seen at all
    const defs = shape('defs');
    this.hatches = [];
    for (const [name, turn] of [['known', 45], ['closed', -45]]) {
      const pattern = defs.appendChild(shape('pattern', {
        id: `${name}-${this.flight.name.replace(/\W/g, '')}`, width: step, height: step,
        patternUnits: 'userSpaceOnUse',
      }));
      this.hatches.push([pattern, turn]);
      pattern.append(shape('rect', { width: step, height: step, class: `${name}-ground` }));
      pattern.append(shape('rect', {
        width: step * (name === 'known' ? 0.22 : 0.5), height: step, class: `${name}-line`,
      }));
    }
    return defs;
  }

  /** Cells that hold data, deeper where it is more. */
  drawWaiting(ground) {
    const bits = new Map();
    for (const { cell, bit } of this.film.sensors) {
      if (bit > 0) bits.set(cell, (bits.get(cell) || 0) + bit);
    }
    const most = Math.max(...bits.values(), 1);
    this.cells = new Map([...bits].map(([cell, bit]) => [cell, ground.appendChild(shape('path', {
      class: 'data', d: this.squares([cell]), 'fill-opacity': 0.18 + 0.42 * (bit / most),
    }))]));
  }

  drawHomes(ground) {
    this.homes = [];
    const seen = new Set();
    for (const { start_m, home_m } of this.film.uavs) {
      for (const [word, [x_m, y_m]] of [['start', start_m], ['home', home_m]]) {
        const key = `${x_m} ${y_m}`;
        if (seen.has(key)) continue;
        seen.add(key);
        const home = ground.appendChild(shape('g', { class: 'home' }));
        home.append(shape('path', { d: 'M-9 0L0 -9L9 0V8H-9z' }));
        home.append(shape('title', {}, word));
        this.homes.push([home, x_m, y_m]);
      }
    }
  }

  makeUavs() {
    const { uavs } = this.film;
    const { trails, hovers } = this.layers;
    this.trails = uavs.map((_, uav) => trails.appendChild(shape('path', {
      class: 'trail', stroke: colourOf(uav), ...(uav < N_COLOURS ? {} : { 'stroke-dasharray': '6 3' }),
    })));
    this.hovers = uavs.map((_, uav) => {
      const group = hovers.appendChild(shape('g'));
      const links = group.appendChild(shape('g', { stroke: colourOf(uav) }));
      const ring = group.appendChild(shape('path', { class: 'ring', stroke: colourOf(uav) }));
      return { group, links, ring, leg: null };
    });
    this.badges = uavs.map((about, uav) => this.badge(about, uav));
  }

  badge(about, uav) {
    const group = this.layers.uavs.appendChild(shape('g', { class: 'uav', 'data-uav': uav + 1 }));
    group.append(shape('title', {}, `UAV ${about.id}`));
    const nose = group.appendChild(shape('path', {
      d: 'M18 0L8 -7V7z', fill: colourOf(uav), class: 'nose',
    }));
    group.append(shape('circle', { r: 11, fill: colourOf(uav) }));
    group.append(shape('text', { fill: inkOn(uav), dy: '0.36em' }, about.id));
    return { group, nose };
  }

  /** Show what is to be seen; sizes in pixels follow the size of the picture. */
  fit() {
    const { clientWidth, clientHeight } = this.svg;
    const { box } = this.extent;
    this.svg.setAttribute('viewBox', box.join(' '));
    const metres = Math.max(box[2] / (clientWidth || 1), box[3] / (clientHeight || 1));
    if (!clientWidth || metres === this.px) return;
    this.px = metres;
    const few = this.film.sensors.length < 1500;
    this.dots.forEach((dot, k) => {
      const radius = this.film.sensors[k].bit > 0 ? (few ? 3.2 : 2) : (few ? 1.8 : 1.2);
      dot.setAttribute('r', radius * metres);
    });
    for (const [pattern, turn] of this.hatches) {
      put(pattern, { patternTransform: `rotate(${turn}) scale(${1 / this.extent.nearness})` });
    }
    this.fitNames(metres);
    for (const [home, x_m, y_m] of this.homes) {
      home.setAttribute('transform', `translate(${x_m} ${this.up(y_m)}) scale(${metres})`);
    }
    this.shown = {};
  }

  /** Names stand where they cover no other one; all of them can be found in the table. */
  fitNames(metres) {
    const taken = new Set();
    const [west_m, , width_m] = this.extent.whole;
    this.names.forEach((name, k) => {
      const { id, x_m, y_m } = this.film.sensors[k];
      const long_m = (5 + 6 * id.length) * metres;
      const sides = [1, -1].filter((side) => (side > 0
        ? x_m + long_m < west_m + width_m : x_m - long_m > west_m));
      const places = [-4, 11].flatMap((below) => sides.map((side) => [side, below]));
      const binsAt = ([side, below]) => binsOf(
        Math.min(x_m + 5 * side * metres, x_m + side * long_m) / metres,
        this.up(y_m) / metres + below, id.length,
      );
      const place = places.find((it) => !binsAt(it).some((bin) => taken.has(bin)));
      if (place) binsAt(place).forEach((bin) => taken.add(bin));
      const [side, below] = place || [1, 0];
      put(name, {
        x: x_m + 5 * side * metres, y: this.up(y_m) + below * metres, 'font-size': 9.5 * metres,
        'text-anchor': side < 0 ? 'end' : 'start', visibility: place ? 'visible' : 'hidden',
      });
    });
  }

  showNames(isNamed) {
    this.isNamed = isNamed;
    this.nameLayer.replaceChildren(...(isNamed ? this.names : []));
  }

  /**
   * Draw the flight at a time; whose: the UAV whose knowledge is shown, or null; others: flights
   * over it; pulse_s: how long a message is seen, on its way or, if still, at its end.
   */
  draw(time_s, whose, others, pulse_s, isStill) {
    const states = this.flight.at(time_s);
    this.drawSensors(time_s);
    this.drawKnown(time_s, whose);
    const aside = this.spread(states);
    states.forEach((state, uav) => this.drawUav(state, time_s, whose, aside[uav]));
    this.drawContacts(states, time_s, pulse_s, isStill);
    this.drawGhosts(others, time_s);
  }

  drawSensors(time_s) {
    const waiting = new Set();
    const { flight } = this; // if it lacks events, some may have read what waits
    const isKnown = flight.isOver && !flight.lacksEvents && time_s >= flight.end_s;
    this.film.sensors.forEach(({ bit, cell }, k) => {
      if (bit <= 0) return;
      const read = flight.readings.get(k);
      let state = 'waiting';
      if (read && time_s >= read.start_s) state = time_s < read.end_s ? 'reading' : 'read';
      if (state === 'waiting') waiting.add(cell);
      if (state === 'waiting' && isKnown) state = 'left';
      if (this.dots[k].getAttribute('class') !== state) this.dots[k].setAttribute('class', state);
    });
    for (const [cell, square] of this.cells) {
      const shown = waiting.has(cell) ? 'data' : 'data done';
      if (square.getAttribute('class') !== shown) square.setAttribute('class', shown);
    }
  }

  drawKnown(time_s, whose) {
    const n = this.flight.eventsUpTo(time_s);
    const key = `${whose} ${n}`;
    if (this.shown.known === key) return;
    this.shown.known = key;
    const cells = [];
    if (whose !== null && this.flight.knows) {
      this.flight.knownBy(whose, time_s).forEach((flag, cell) => flag && cells.push(cell));
    }
    const open = cells.filter((cell) => !this.noCells.has(cell));
    put(this.known, { d: this.squares(open), 'data-cells': cells.length });
  }

  /** How far aside each UAV is drawn, so that of those at one place all can be seen. */
  spread(states) {
    const groups = new Map();
    for (const { uav, x_m, y_m } of states) {
      const place = `${Math.round(x_m / this.px / 4)} ${Math.round(y_m / this.px / 4)}`;
      groups.set(place, [...(groups.get(place) || []), uav]);
    }
    const aside = states.map(() => [0, 0]);
    for (const group of groups.values()) {
      if (group.length === 1) continue;
      const radius = Math.max(9, 3.2 * group.length) * this.px;
      group.forEach((uav, k) => {
        const angle = (2 * Math.PI * k) / group.length + Math.PI;
        aside[uav] = [radius * Math.cos(angle), radius * Math.sin(angle)];
      });
    }
    return aside;
  }

  drawUav(state, time_s, whose, aside) {
    const { group, nose } = this.badges[state.uav];
    const [x, y] = [state.x_m, this.up(state.y_m)];
    put(group, {
      transform: `translate(${x + aside[0]} ${y + aside[1]}) scale(${this.px})`,
      'data-x': state.x_m, 'data-y': state.y_m,
      class: ['uav', state.is_home && 'landed', whose === state.uav && 'chosen',
        this.flight.faultsOf(state.uav, time_s).length && 'faulty'].filter(Boolean).join(' '),
    });
    const degrees = state.heading === null ? 0 : (-state.heading * 180) / Math.PI;
    put(nose, {
      transform: `rotate(${degrees})`,
      visibility: state.heading === null || state.is_home ? 'hidden' : 'visible',
    });
    this.drawTrail(state, x, y);
    this.drawHover(state, x, y, time_s);
  }

  drawTrail(state, x, y) {
    const { legs } = this.flight.ways[state.uav];
    if (!state.leg) {
      this.trails[state.uav].setAttribute('d', '');
      return;
    }
    const key = `trail ${state.uav}`;
    const cached = this.shown[key];
    if (!cached || cached.leg !== state.leg) {
      const passed = legs.slice(Math.max(0, state.n_legs - MOST_LEGS), state.n_legs)
        .map(({ points: [[x_m, y_m]] }) => `${x_m} ${this.up(y_m)}`);
      this.shown[key] = { leg: state.leg, d: `M${passed.join('L')}` };
    }
    const { points, lengths } = state.leg;
    const done_m = state.share * lengths[lengths.length - 1];
    const corners = points.filter((_, k) => k > 0 && lengths[k] < done_m)
      .map(([x_m, y_m]) => `L${x_m} ${this.up(y_m)}`);
    this.trails[state.uav].setAttribute('d', `${this.shown[key].d}${corners.join('')}L${x} ${y}`);
  }

  /** A hover: a ring that closes as it goes, and a line to each sensor, as wide as its share. */
  drawHover(state, x, y, time_s) {
    const hover = this.hovers[state.uav];
    const leg = state.leg && state.leg.action === HOVER && state.share < 1 ? state.leg : null;
    hover.group.setAttribute('visibility', leg ? 'visible' : 'hidden');
    if (!leg) {
      hover.leg = null;
      hover.links.replaceChildren();
      return;
    }
    hover.ring.setAttribute('d', arc(x, y, 17 * this.px, state.share));
    if (hover.leg !== leg) {
      hover.leg = leg;
      hover.links.replaceChildren(...leg.reads.map((read) => {
        const { id, x_m, y_m } = this.film.sensors[read.sensor];
        const link = shape('line', {
          x1: x, y1: y, x2: x_m, y2: this.up(y_m), 'stroke-width': 1 + 6 * (read.share || 0.1),
        });
        link.append(shape('title', {}, `${id}: ${rate(read.bps)}`));
        return link;
      }));
    }
    leg.reads.forEach((read, k) => {
      hover.links.children[k].setAttribute('class', time_s < read.end_s ? 'link' : 'link done');
    });
  }

  drawContacts(states, time_s, pulse_s, isStill) {
    const pairs = this.flight.contactsAt(states, time_s);
    const message = this.flight.messageAt(time_s, pulse_s);
    const parts = pairs.map(([a, b]) => shape('line', {
      class: 'contact', x1: a.x_m, y1: this.up(a.y_m), x2: b.x_m, y2: this.up(b.y_m),
      'data-pair': `${a.uav + 1} ${b.uav + 1}`,
    }));
    if (message) {
      const to = states[message.uav];
      const share = isStill ? 1 : Math.min(1, (time_s - message.time_s) / pulse_s);
      for (const sender of message.heard) {
        const from = states[sender];
        parts.push(shape('line', {
          class: 'message', x1: from.x_m, y1: this.up(from.y_m), x2: to.x_m, y2: this.up(to.y_m),
        }));
        parts.push(shape('circle', {
          class: 'message', r: 3.5 * this.px,
          cx: from.x_m + (to.x_m - from.x_m) * share,
          cy: this.up(from.y_m + (to.y_m - from.y_m) * share),
        }));
      }
    }
    this.layers.contacts.setAttribute('class', pairs.length > 20 ? 'contacts many' : 'contacts');
    this.layers.contacts.replaceChildren(...parts);
  }

  /** Other flights over this one, a diamond with the UAV's number each. */
  drawGhosts(others, time_s) {
    const parts = [];
    for (const { flight, mark } of others) {
      for (const state of flight.at(time_s)) {
        const place = `${state.x_m} ${this.up(state.y_m)}`;
        const group = shape('g', {
          class: 'ghost', transform: `translate(${place}) scale(${this.px})`,
        });
        group.append(shape('title', {}, `${flight.name}, UAV ${state.uav + 1}`));
        group.append(shape('path', { d: 'M0 -12L12 0L0 12L-12 0z', stroke: colourOf(state.uav) }));
        group.append(shape('text', { dy: '0.36em' }, `${mark}${state.uav + 1}`));
        parts.push(group);
      }
    }
    this.layers.ghosts.replaceChildren(...parts);
  }
}

/** The parts of a picture that a text covers, by its left end and its foot [px]. */
function binsOf(x, y, n_letters) {
  const rows = new Set([Math.floor((y - 8) / 10), Math.floor(y / 10)]);
  const first = Math.floor(x / 6);
  return [...rows].flatMap((row) => Array.from({ length: n_letters + 1 },
    (_, k) => `${first + k} ${row}`));
}

/** A part of a circle from its top, clockwise. */
function arc(x, y, radius, share) {
  const angle = 2 * Math.PI * Math.min(share, 0.9999);
  const [end_x, end_y] = [x + radius * Math.sin(angle), y - radius * Math.cos(angle)];
  return `M${x} ${y - radius}A${radius} ${radius} 0 ${share > 0.5 ? 1 : 0} 1 ${end_x} ${end_y}`;
}
