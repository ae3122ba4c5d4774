// A mission that still flies: what comes of it by and by, and what its world is asked to do.

const GLIDE_S = 0.8; // in which what is shown comes near the latest event; nothing is known after it
const REFRESH_MS = 200; // at most so often more of a mission is taken in
const AGAIN_MS = 1500; // from one try to find the viewer to the next
const NEXT_MS = 2500; // from the end of a mission to the next one
const PACES = [[0, 'full speed'], [1, '1×'], [2, '2×'], [5, '5×'], [10, '10×'], [20, '20×'],
  [60, '60×']];
KEYS.push(['l', 'latest event of a mission that flies']);
const KEPT = ['speed', 'theme']; // from mission to mission

/** A player that follows the latest event, or looks at its own pace, and waits there for more. */
class LivePlayer extends Player {
  isFollowing = true; // until another moment or pace is chosen, or the mission is over

  connect() {
    super.connect();
    byId('speed').addEventListener('change', () => { this.isFollowing = false; });
  }

  get end_s() {
    const { events, isOver, end_s: last_s } = this.flight;
    if (isOver) return last_s;
    return events.length ? events[events.length - 1].time_s : 0;
  }

  get isAtEnd() {
    return this.flight.isOver && this.time_s >= this.end_s;
  }

  frame(now_ms) {
    if (!this.isPlaying) return;
    const passed_s = this.last_ms === null ? 0 : Math.min(0.25, (now_ms - this.last_ms) / 1e3);
    this.last_ms = now_ms;
    const left_s = this.end_s - this.time_s;
    const most_s = this.flight.isOver ? left_s : left_s * (1 - Math.exp(-passed_s / GLIDE_S));
    const pace_s = this.isFollowing ? Infinity : passed_s * this.speed;
    this.time_s += Math.max(0, Math.min(pace_s, most_s));
    this.draw();
    if (this.isAtEnd) this.pause();
    else requestAnimationFrame((next_ms) => this.frame(next_ms));
  }

  play() {
    if (this.isAtEnd) this.time_s = 0;
    const { time_s } = this;
    super.play();
    this.time_s = time_s; // at the latest event it waits for more
  }

  /** Take in more of the mission. */
  take(updates) {
    const { flight, film } = this;
    flight.add(updates.flatMap(({ event }) => (event ? [event] : [])));
    flight.faults.push(...updates.flatMap(({ faults = [] }) => faults));
    flight.isOver = flight.isOver || updates.some((update) => update.is_over);
    flight.lacksEvents = flight.lacksEvents || updates.some((update) => update.lacks_events);
    this.isFollowing = this.isFollowing && !flight.isOver;
    const notes = new Set([...film.notes, ...updates.flatMap(({ note }) => note || [])]);
    if (notes.size > film.notes.length) this.note(film.notes = [...notes]);
    if (updates.some(({ event }) => event && event.reads)) this.sensors.fill();
    this.resized();
  }

  deedOf(key, isShifted) {
    return key === 'l' ? () => this.follow() : super.deedOf(key, isShifted);
  }

  seek(time_s) {
    this.isFollowing = false;
    super.seek(time_s);
  }

  changeSpeed(by) {
    this.isFollowing = false;
    super.changeSpeed(by);
  }

  follow() {
    this.seek(this.end_s);
    this.isFollowing = !this.flight.isOver;
    if (!this.isPlaying && !this.isAtEnd) this.play();
  }
}

/** What the viewer sends, and what it is asked. */
class Live {
  constructor(film) {
    this.mission = film ? film.live.mission : '';
    this.player = film ? new LivePlayer(film) : null;
    this.next = ''; // the mission after this one
    this.n_events = 0; // of the mission that have come
    this.updates = []; // that are not taken in yet
    this.state = {};
    this.isHeard = false;
    this.wasHeard = false; // once at least
    this.build();
    this.listen();
    if (this.player) {
      this.recall();
      this.player.play();
    }
    setInterval(() => this.look(), REFRESH_MS);
  }

  build() {
    this.status = node('span', { id: 'live-status', role: 'status' });
    this.said = node('span', { id: 'live-said', role: 'status' });
    this.newest = this.button('newest', 'Newest', () => this.player.follow());
    this.newest.title = 'go to the latest event (l)';
    this.goOn = this.button('next', 'Next mission', () => this.reload());
    this.steering = node('div', { id: 'live-steering', role: 'group', 'aria-label': 'The world' },
      ...this.controls());
    byId('notes').before(node('div', { id: 'live' }, this.status, this.newest, this.goOn,
      this.steering, this.said));
    document.body.classList.toggle('waiting', !this.player);
    byId('play').title = 'play or pause this page, not the world (space)';
    this.show();
  }

  button(name, text, deed) {
    const it = node('button', { type: 'button', id: `live-${name}` }, text);
    it.addEventListener('click', deed);
    return it;
  }

  controls() {
    const ask = (command, text) => this.button(command, text, () => this.ask({ command }));
    const seed = node('input', { id: 'live-seed', type: 'number', min: 0, step: 1, value: 0 });
    const pace = node('select', { id: 'live-pace' }, node('option', { value: '' }, 'pace'),
      ...PACES.map(([value, text]) => node('option', { value }, text)));
    pace.addEventListener('change', () => {
      if (pace.value) this.ask({ command: 'pace', pace: Number(pace.value) });
    });
    const start = () => this.ask({ command: 'start', seed: Number(seed.value) });
    return [ask('pause', 'Pause world'), ask('resume', 'Go on'), ask('step', 'One event'),
      node('label', {}, 'World at ', pace), node('label', {}, 'Seed ', seed),
      this.button('start', 'Start', start), ask('abort', 'Abort')];
  }

  /** Connect, and connect again whenever that ends. */
  listen() {
    const at = `mission=${encodeURIComponent(this.mission)}&n_events=${this.n_events}`;
    const socket = new WebSocket(`ws://${location.host}/live?${at}`);
    this.socket = socket;
    socket.addEventListener('message', ({ data }) => this.hear(JSON.parse(data)));
    socket.addEventListener('close', () => {
      this.isHeard = false;
      this.show();
      setTimeout(() => this.listen(), AGAIN_MS);
    });
  }

  hear({ state, said, mission, updates = [] }) {
    this.isHeard = this.wasHeard = true;
    if (state) this.state = state;
    if (said) this.said.textContent = said;
    if (mission) this.next = mission;
    for (const update of updates) {
      // After a viewer has come again the latest event comes again, too.
      if (!update.event || update.n_events > this.n_events) this.updates.push(update);
      this.n_events = Math.max(this.n_events, update.n_events);
    }
    this.show();
  }

  ask(wish) {
    this.said.textContent = '';
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(wish));
  }

  /** Take in what has come, and go on with the next mission when this one has been seen. */
  look() {
    if (this.updates.length && this.player) this.player.take(this.updates.splice(0));
    this.show();
    if (!this.next || this.leaving) return;
    if (!this.player) this.reload();
    else if (this.player.isAtEnd) {
      this.leaving = setTimeout(() => {
        this.leaving = null;
        if (this.player.isAtEnd) this.reload();
      }, NEXT_MS);
    }
  }

  show() {
    this.newest.hidden = !this.player || this.player.flight.isOver;
    this.showWorld();
    this.goOn.hidden = !(this.next && this.player);
    this.steering.hidden = !this.state.control || !this.isHeard;
    const text = this.statusText();
    if (this.status.textContent !== text) this.status.textContent = text;
  }

  /** Nobody is asked who is not there. */
  showWorld() {
    const it = this.steering.querySelectorAll('button, input, select');
    for (const control of it) control.disabled = !this.state.world;
  }

  statusText() {
    if (!this.wasHeard) return 'Connecting to the viewer.';
    if (!this.isHeard) return 'The viewer is gone; looking for it.';
    if (!this.player) return this.state.world ? 'Waiting for a mission.' : 'Waiting for a world.';
    const world = this.state.world ? '.' : '; the world is gone.';
    if (this.next) return `The next mission has begun${world}`;
    if (this.player.flight.isOver) return `The mission is over${world}`;
    const behind_s = this.player.end_s - this.player.time_s;
    if (behind_s < 1) return `Live${world}`;
    const behind = `${behind_s.toFixed(0)} s behind${world}`;
    return this.player.isFollowing ? `Live, ${behind}` : behind;
  }

  reload() {
    sessionStorage.setItem('speed', byId('speed').value);
    sessionStorage.setItem('theme', document.documentElement.dataset.theme || '');
    location.reload();
  }

  /** What was chosen before the page began anew. */
  recall() {
    const [speed, theme] = KEPT.map((key) => sessionStorage.getItem(key));
    if (speed) byId('speed').value = speed;
    if (theme) document.documentElement.dataset.theme = theme;
    this.player.nameTheme();
  }
}

window.live = new Live(JSON.parse(byId('footage').textContent));
window.film = window.live.player;
