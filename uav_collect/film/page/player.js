// The clock of the film: what plays, pauses and steps, by buttons, keys and the slider.

const SPEEDS = [1, 2, 5, 10, 20, 30, 60];
const FIRST_SPEED = 10;
const KEYS = [
  ['space', 'play or pause'], ['← →', 'event before, next event'],
  ['shift ← →', '10 s back, 10 s on'], ['home, end', 'start, end'], ['+ −', 'faster, slower'],
  ['1 … 9', 'what that UAV knows'], ['0', 'the truth again'], ['g', 'ghosts over the map or not'],
  ['n', 'names of sensors or not'], ['i o', 'nearer, farther, about the UAV that is chosen'],
  ['w', 'the whole map'], ['d', 'light or dark'], ['?', 'these keys'],
];

class Player {
  constructor(film) {
    this.film = film;
    this.flights = film.flights.map((record) => new Flight(film, record));
    [this.flight] = this.flights;
    this.time_s = 0;
    this.whose = null;
    this.isPlaying = false;
    this.still = matchMedia('(prefers-reduced-motion: reduce)');
    this.describe();
    const seek = (time_s) => this.seek(time_s);
    this.totals = new Totals(film, this.flight);
    this.table = new FlightTable(this.flights, () => this.arrange());
    this.sensors = new SensorTable(film, this.flight, seek);
    this.chart = new Chart(film, this.flights, seek);
    this.extent = new Extent(film, this.flights);
    this.map = this.mapOf(this.flight, 'this mission', this.mapLabel());
    this.beside = [];
    drawLegend(film);
    this.makeChoices();
    this.connect();
    this.resized();
  }

  /** When the last flight that is shown ends. */
  get end_s() {
    const ghosts = [...this.table.chosen('over'), ...this.table.chosen('beside')];
    return Math.max(this.flight.end_s, ...ghosts.map(({ flight }) => flight.end_s));
  }

  mapLabel() {
    const { area, sensors, uavs } = this.film;
    return `Map of ${area.columns} by ${area.rows} cells of ${area.cell_size_m} m, `
      + `${sensors.length} sensors, ${uavs.length} UAVs`;
  }

  describe() {
    const { film } = this;
    const policies = [...new Set(film.uavs.map(({ policy }) => policy))].join(', ');
    byId('title').textContent = film.scenario;
    byId('subtitle').textContent = `mission seed ${film.seed}, ${film.uavs.length} UAV`
      + `${film.uavs.length === 1 ? '' : 's'}: ${policies}`;
    byId('key-list').append(...KEYS.flatMap(([key, deed]) => [
      node('dt', {}, key), node('dd', {}, deed)]));
    byId('speed').append(...SPEEDS.map((it) => node('option', { value: it }, `${it}×`)));
    byId('speed').value = FIRST_SPEED;
    this.note(film.notes);
  }

  note(lines) {
    byId('notes').replaceChildren(...lines.map((line) => node('p', { className: 'note' }, line)));
  }

  mapOf(flight, name, label) {
    const figure = node('figure', { className: 'map' }, node('figcaption', {}, name));
    byId('maps').append(figure);
    const map = new FlightMap(this.film, flight, figure, label, this.extent);
    makeNear(map.svg, this.extent, () => this.look());
    return map;
  }

  makeChoices() {
    const { film } = this;
    const choose = (uav) => this.choose(uav === this.whose ? null : uav);
    this.cards = film.uavs.map((_, uav) => new Card(film, this.flight, uav, byId('cards'), choose));
    const truth = node('button', { type: 'button', id: 'truth' }, 'True state');
    truth.addEventListener('click', () => this.choose(null));
    this.truth = truth;
    this.whoseText = node('span');
    byId('whose').append(truth, this.whoseText);
  }

  choose(uav) {
    if (uav !== null && (uav >= this.film.uavs.length || !this.flight.knows)) return;
    this.whose = uav;
    this.draw();
  }

  connect() {
    const on = (id, type, deed) => byId(id).addEventListener(type, deed);
    on('play', 'click', () => this.toggle());
    on('back', 'click', () => this.step(-1));
    on('on', 'click', () => this.step(1));
    on('time', 'input', () => this.seek(Number(byId('time').value)));
    on('nearer', 'click', () => this.approach(2));
    on('farther', 'click', () => this.approach(1 / 2));
    on('theme', 'click', () => this.turnTheme());
    on('keys-button', 'click', () => byId('keys').showModal());
    on('keys-close', 'click', () => byId('keys').close());
    document.addEventListener('keydown', (event) => this.press(event));
    // A button that was clicked gives the space bar back to the player.
    document.addEventListener('click', ({ detail, target }) => {
      if (detail > 0) target.closest('button, input[type=checkbox]')?.blur();
    });
    new ResizeObserver(() => this.resized()).observe(byId('maps'));
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.nameTheme());
    this.nameTheme();
  }

  isDark() {
    const { theme } = document.documentElement.dataset;
    return theme ? theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
  }

  turnTheme() {
    document.documentElement.dataset.theme = this.isDark() ? 'light' : 'dark';
    this.nameTheme();
  }

  nameTheme() {
    byId('theme').textContent = this.isDark() ? 'Light' : 'Dark';
  }

  resized() {
    byId('time').max = this.end_s;
    this.extent.fit();
    document.body.classList.toggle('wide', this.extent.aspect > WIDE);
    byId('maps').style.setProperty('--aspect', this.extent.aspect);
    byId('maps').style.setProperty('--columns', this.columns());
    this.sensors.fit();
    this.fitMaps();
    this.chart.build();
    drawStrip(this.film, this.flight, this.end_s);
    this.draw();
  }

  /** In how many columns the maps are largest. */
  columns() {
    const { clientWidth, clientHeight } = byId('maps');
    const n_maps = 1 + this.beside.length;
    const sizeIn = (columns) => Math.min(clientWidth / columns / this.extent.aspect,
      clientHeight / Math.ceil(n_maps / columns));
    const counts = Array.from({ length: n_maps }, (_, k) => k + 1);
    return counts.reduce((best, columns) => (sizeIn(columns) > sizeIn(best) ? columns : best));
  }

  fitMaps() {
    for (const map of [this.map, ...this.beside]) map.fit();
    byId('maps').classList.toggle('near', this.extent.nearness > 1);
    byId('farther').disabled = this.extent.nearness === 1;
  }

  /** Show what part of the map is to be seen now. */
  look() {
    this.fitMaps();
    this.draw();
  }

  /** Come nearer to the UAV that is chosen, or to the middle, or go farther. */
  approach(factor) {
    if (this.whose !== null) {
      const { x_m, y_m } = this.flight.uavAt(this.whose, this.time_s);
      this.extent.moveTo([x_m, this.map.up(y_m)]);
    }
    this.extent.approach(factor);
    this.look();
  }

  /** Show the ghosts that are chosen, over the map and beside it. */
  arrange() {
    const wanted = this.table.chosen('beside');
    const shown = this.beside.map(({ flight }) => flight);
    if (wanted.length !== shown.length || wanted.some(({ flight }) => !shown.includes(flight))) {
      for (const { svg } of this.beside) svg.parentElement.remove();
      this.beside = wanted.map(
        ({ flight }) => this.mapOf(flight, flight.name, `${flight.name}: ${this.mapLabel()}`),
      );
      byId('maps').dataset.count = 1 + this.beside.length;
    }
    this.time_s = Math.min(this.time_s, this.end_s);
    this.resized();
  }

  press(event) {
    const { key, target } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || byId('keys').open) return;
    if (target.matches('input[type=search], select')) return;
    const isOnControl = target.matches('button, input[type=checkbox]');
    if ((key === ' ' || key === 'Enter') && isOnControl) return;
    const deed = this.deedOf(key, event.shiftKey);
    if (!deed) return;
    event.preventDefault();
    deed();
  }

  deedOf(key, isShifted) {
    if (/^[0-9]$/.test(key)) return () => this.choose(key === '0' ? null : Number(key) - 1);
    return {
      ' ': () => this.toggle(),
      ArrowLeft: () => (isShifted ? this.seek(this.time_s - 10) : this.step(-1)),
      ArrowRight: () => (isShifted ? this.seek(this.time_s + 10) : this.step(1)),
      Home: () => this.seek(0),
      End: () => this.seek(this.end_s),
      '+': () => this.changeSpeed(1),
      '=': () => this.changeSpeed(1),
      '-': () => this.changeSpeed(-1),
      g: () => this.turnGhosts(),
      n: () => this.turnNames(),
      i: () => this.approach(2),
      o: () => this.approach(1 / 2),
      w: () => {
        this.extent.showAll();
        this.look();
      },
      d: () => this.turnTheme(),
      '?': () => byId('keys').showModal(),
    }[key];
  }

  changeSpeed(by) {
    const at = SPEEDS.indexOf(this.speed) + by;
    byId('speed').value = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, at))];
  }

  get speed() {
    return Number(byId('speed').value);
  }

  turnGhosts() {
    const isAny = this.table.chosen('over').length > 0;
    this.table.rows.slice(1).forEach(({ boxes: [over] }) => { over.checked = !isAny; });
    this.arrange();
  }

  turnNames() {
    for (const map of [this.map, ...this.beside]) map.showNames(!map.isNamed);
  }

  toggle() {
    if (this.isPlaying) this.pause();
    else this.play();
  }

  play() {
    if (this.time_s >= this.end_s) this.time_s = 0;
    this.isPlaying = true;
    this.last_ms = null;
    byId('play').textContent = 'Pause';
    byId('said').textContent = '';
    requestAnimationFrame((now_ms) => this.frame(now_ms));
  }

  pause() {
    this.isPlaying = false;
    byId('play').textContent = 'Play';
    this.say();
  }

  frame(now_ms) {
    if (!this.isPlaying) return;
    const passed_s = this.last_ms === null ? 0 : Math.min(0.25, (now_ms - this.last_ms) / 1e3);
    this.last_ms = now_ms;
    this.time_s = Math.min(this.end_s, this.time_s + passed_s * this.speed);
    this.draw();
    if (this.time_s >= this.end_s) this.pause();
    else requestAnimationFrame((next_ms) => this.frame(next_ms));
  }

  seek(time_s) {
    this.time_s = Math.max(0, Math.min(this.end_s, time_s));
    this.draw();
    if (!this.isPlaying) this.say();
  }

  /** To the next event, or the one before; after the last one to the end. */
  step(by) {
    if (this.isPlaying) this.pause();
    const { events } = this.flight;
    const n = this.flight.eventsUpTo(this.time_s);
    if (by > 0) {
      this.seek(n < events.length ? events[n].time_s : this.end_s);
      return;
    }
    const before = lastUpTo(n, (k) => events[k].time_s, this.time_s - 1e-9);
    this.seek(before >= 0 ? events[before].time_s : 0);
  }

  /** Say in words what the latest event is. */
  say() {
    const n = this.flight.eventsUpTo(this.time_s);
    const text = byId('said');
    if (n === 0) {
      text.textContent = this.flight.events.length ? '' : 'nothing has happened yet';
      return;
    }
    const event = this.flight.events[n - 1];
    const heard = (event.heard || []).map((uav) => this.film.uavs[uav].id).join(', ');
    text.textContent = `event ${n} of ${this.flight.events.length}: `
      + `UAV ${this.film.uavs[event.uav].id} `
      + `${ACTIONS[event.action]}${event.collected_bit > 0 ? `, ${mbit(event.collected_bit)}` : ''}`
      + `${event.action === HOME ? `: ${event.reason}` : ''}${heard ? `; it heard ${heard}` : ''}`;
  }

  draw() {
    const { time_s, whose } = this;
    const pulse_s = Math.min(1.2 * this.speed, 20);
    const over = this.table.chosen('over');
    this.map.draw(time_s, whose, over, pulse_s, this.still.matches);
    for (const map of this.beside) map.draw(time_s, null, [], pulse_s, this.still.matches);
    const states = this.flight.at(time_s);
    this.cards.forEach((card, uav) => card.draw(states[uav], time_s, uav === whose));
    this.totals.draw(time_s);
    this.table.draw(time_s);
    this.sensors.draw(time_s);
    this.chart.draw(time_s);
    this.drawClock();
  }

  drawClock() {
    byId('time').value = this.time_s;
    byId('clock').textContent = `${this.time_s.toFixed(1)} s of ${this.end_s.toFixed(1)} s`;
    byId('time').setAttribute('aria-valuetext', byId('clock').textContent);
    this.truth.setAttribute('aria-pressed', this.whose === null);
    this.whoseText.textContent = this.whose === null
      ? 'All data that waits.'
      : `Hatched: complete, as UAV ${this.film.uavs[this.whose].id} knows.`;
  }
}
