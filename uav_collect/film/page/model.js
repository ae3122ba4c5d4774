// A film's data, and how a fleet stands at any time of it. Nothing here knows of the page.

const HOVER = 0;
const HOME = 5;
const ACTIONS = ['hovers', 'flies north', 'flies east', 'flies south', 'flies west', 'flies home'];
const MOST_BENDS = 1000; // of a curve: it has fewer pixels
const STEPS = [[0, 0], [0, 1], [1, 0], [0, -1], [-1, 0]]; // by action, east and north

/** The last index whose value is at most the limit; -1 where there is none. */
function lastUpTo(count, valueAt, limit) {
  let low = 0;
  let high = count;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (valueAt(middle) <= limit) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** One mission as somebody flew it: its events, and what follows from them. */
class Flight {
  constructor(film, record) {
    this.film = film;
    this.name = record.name;
    this.knows = record.knows;
    this.isOver = record.is_over;
    this.lacksEvents = record.lacks_events;
    this.faults = record.faults;
    this.events = [];
    this.ways = film.uavs.map(() => ({ legs: [], bit: [0] })); // bit: collected before each leg
    this.readings = new Map(); // by sensor
    this.totals = [0]; // collected by all before each event
    this.news = film.uavs.map(() => []); // what each came to know, by event
    this.box_m = [Infinity, Infinity, -Infinity, -Infinity]; // west, south, east, north of all ways
    this.end_s = 0;
    this.add(record.events);
  }

  /** More events of a mission that still flies. */
  add(events) {
    for (const event of events) {
      const leg = this.legOf(event, this.events.length);
      const way = this.ways[event.uav];
      this.events.push(event);
      way.legs.push(leg);
      way.bit.push(way.bit[way.bit.length - 1] + event.collected_bit);
      this.totals.push(this.totals[this.totals.length - 1] + event.collected_bit);
      this.end_s = Math.max(this.end_s, leg.end_s);
      for (const read of leg.reads) this.readings.set(read.sensor, read);
      for (const [who, runs] of event.news || []) this.news[who].push([leg.number, runs]);
      for (const [x_m, y_m] of leg.points) stretch(this.box_m, [x_m, y_m, x_m, y_m]);
    }
  }

  legOf(event, number) {
    const [east, north] = STEPS[event.action] || [0, 0];
    const size_m = this.film.area.cell_size_m;
    const here = [event.x_m, event.y_m];
    let points = [here, [event.x_m + east * size_m, event.y_m + north * size_m]];
    if (event.action === HOME) points = [here, ...event.way];
    const lengths = [0];
    for (let k = 1; k < points.length; k += 1) {
      const [a, b] = [points[k - 1], points[k]];
      lengths.push(lengths[k - 1] + Math.hypot(b[0] - a[0], b[1] - a[1]));
    }
    const leg = {
      event, number, points, lengths, uav: event.uav, action: event.action,
      start_s: event.time_s, end_s: event.time_s + event.duration_s,
    };
    leg.reads = this.readsOf(leg, event.reads || []);
    return leg;
  }

  /** What a hover reads: of each sensor its rate and share of the bandwidth, null if not known. */
  readsOf(leg, reads) {
    const total_hz = reads.reduce((sum, [, hz]) => sum + hz, 0);
    return reads.map(([sensor, hz, bps]) => {
      const { bit } = this.film.sensors[sensor];
      const end_s = bps ? Math.min(leg.end_s, leg.start_s + bit / bps) : leg.end_s;
      const share = hz === null ? null : hz / total_hz;
      return { sensor, bps, share, bit, uav: leg.uav, start_s: leg.start_s, end_s };
    });
  }

  /** How many events have happened up to a time. */
  eventsUpTo(time_s) {
    return lastUpTo(this.events.length, (k) => this.events[k].time_s, time_s) + 1;
  }

  /** A UAV at a time: where, what it does, its energy, what it has collected. */
  uavAt(uav, time_s) {
    const { legs, bit } = this.ways[uav];
    const about = this.film.uavs[uav];
    const k = lastUpTo(legs.length, (index) => legs[index].start_s, time_s);
    if (k < 0) {
      const [x_m, y_m] = about.start_m;
      return { uav, x_m, y_m, heading: null, leg: null, n_legs: 0, share: 0, is_home: false,
        energy_j: about.budget_j, collected_bit: 0 };
    }
    const leg = legs[k];
    const span_s = leg.end_s - leg.start_s;
    const share = span_s > 0 ? Math.min(1, Math.max(0, (time_s - leg.start_s) / span_s)) : 1;
    const place = along(leg, share);
    return {
      uav, leg, n_legs: k + 1, share, ...place,
      is_home: leg.action === HOME && share >= 1,
      energy_j: leg.event.energy_left_j - leg.event.energy_j * share,
      collected_bit: bit[k] + collectedIn(leg, share, time_s),
    };
  }

  /** All UAVs at a time. */
  at(time_s) {
    return this.film.uavs.map((_, uav) => this.uavAt(uav, time_s));
  }

  collectedAt(time_s) {
    return this.at(time_s).reduce((sum, each) => sum + each.collected_bit, 0);
  }

  energyUsedAt(time_s) {
    return this.at(time_s).reduce(
      (sum, each) => sum + this.film.uavs[each.uav].budget_j - each.energy_j, 0,
    );
  }

  /** Times at which the collected data begins or ceases to grow; of very many ones regular ones. */
  bends() {
    if (this.events.length > MOST_BENDS) {
      return Array.from({ length: MOST_BENDS + 1 }, (_, k) => (this.end_s * k) / MOST_BENDS);
    }
    const times = new Set([0, this.end_s]);
    for (const { legs } of this.ways) {
      for (const leg of legs) {
        if (leg.action !== HOVER) continue;
        times.add(leg.start_s).add(leg.end_s);
        for (const read of leg.reads) times.add(read.end_s);
      }
    }
    return [...times].sort((a, b) => a - b);
  }

  /** The cells that a UAV knows to be complete at a time. */
  knownBy(uav, time_s) {
    const { area } = this.film;
    const known = new Uint8Array(area.rows * area.columns);
    const n = this.eventsUpTo(time_s);
    for (const [number, runs] of this.news[uav]) {
      if (number >= n) break;
      for (let j = 0; j < runs.length; j += 2) known.fill(1, runs[j], runs[j] + runs[j + 1]);
    }
    return known;
  }

  /** What has befallen a UAV by a time: kinds of faults. */
  faultsOf(uav, time_s) {
    const begun = this.faults.filter((it) => it.uav === uav && it.time_s <= time_s);
    return begun.map(({ fault }) => fault);
  }

  /** Pairs of UAVs within range of each other, neither landed nor silent. */
  contactsAt(states, time_s) {
    const range_m = this.film.contact_range_m;
    const heard = states.filter((it) => !it.is_home && !this.faultsOf(it.uav, time_s).includes('silent'));
    const pairs = [];
    heard.forEach((a, k) => heard.slice(k + 1).forEach((b) => {
      const apart_m = Math.hypot(a.x_m - b.x_m, a.y_m - b.y_m);
      if (range_m === null || apart_m <= range_m) pairs.push([a, b]);
    }));
    return pairs;
  }

  /** The latest event up to a time at which messages were heard, if it is recent. */
  messageAt(time_s, recent_s) {
    for (let k = this.eventsUpTo(time_s) - 1; k >= 0; k -= 1) {
      const event = this.events[k];
      if (time_s - event.time_s > recent_s) return null;
      if (event.heard) return event;
    }
    return null;
  }
}

/** Where a leg is when a share of it is done, and where it leads. */
function along(leg, share) {
  const { points, lengths } = leg;
  const done_m = share * lengths[lengths.length - 1];
  let k = 1;
  while (k < points.length - 1 && lengths[k] < done_m) k += 1;
  const [a, b] = [points[k - 1], points[k]];
  const part_m = lengths[k] - lengths[k - 1];
  const part = part_m > 0 ? (done_m - lengths[k - 1]) / part_m : 0;
  return {
    x_m: a[0] + (b[0] - a[0]) * part,
    y_m: a[1] + (b[1] - a[1]) * part,
    heading: part_m > 0 ? Math.atan2(b[1] - a[1], b[0] - a[0]) : null,
  };
}

/** What a hover has collected by a time of it. */
function collectedIn(leg, share, time_s) {
  if (leg.action !== HOVER) return 0;
  if (share >= 1 || !leg.reads.length || leg.reads.some((read) => !read.bps)) {
    return leg.event.collected_bit * share;
  }
  return leg.reads.reduce(
    (sum, read) => sum + Math.min(read.bit, read.bps * (time_s - leg.start_s)), 0,
  );
}

const mbit = (bit) => `${(bit / 1e6).toFixed(2)} Mbit`;
const kilojoule = (joule) => `${(joule / 1e3).toFixed(1)} kJ`;
const rate = (bps) => (bps ? `${(bps / 1e6).toFixed(2)} Mbit/s` : 'rate not known');
const percent = (share) => `${Math.round(share * 100)} %`;
const seconds = (time_s) => `${time_s.toFixed(1)} s`;
