// Driving by hand: the keys of `navstack teleop`, which the server names, arrow keys and WASD, a pad for touch, and game pads.
// The robot stops when everything is released, the page loses the focus or the connection breaks.
import { $ } from './dom.js';

const REPEAT_MS = 150, SOONEST_MS = 50, SECONDS = 0.5, DEAD_ZONE = 0.15;
/** Direction [forward, left] of a key, by its place on the keyboard. */
const DIRECTIONS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1], KeyW: [1, 0], KeyS: [-1, 0], KeyA: [0, 1], KeyD: [0, -1] };

export class Teleop {
  constructor(app) {
    this.app = app;
    this.on = false;
    this.keys = { moves: {}, speeds: {} };
    this.linear = this.angular = null; // m/s, rad/s
    this.held = null; // key of teleop
    this.down = new Map(); // code of a held arrow or letter -> with Shift
    this.stick = null; // [forward, left] of the pad, -1 .. 1
    this.sticks = null; // those of a game pad: [forward, sideways, turn]
    addEventListener('blur', () => this.release());
    addEventListener('keyup', (event) => {
      this.down.delete(event.code);
      if (this.held && event.key.toLowerCase() === this.held.toLowerCase()) this.held = null;
      this.follow();
    });
    addEventListener('gamepadconnected', (event) => { app.toast(`game pad: ${event.gamepad.id}; T drives by hand`); });
    this.listen($('pad'), $('knob'));
    $('pad-speed').addEventListener('input', (event) => { const factor = Number(event.target.value) / this.linear; this.linear *= factor; this.angular *= factor; app.changed(); });
  }

  world(world) {
    this.keys = world.teleop;
    this.linear ??= world.teleop.speed;
    this.angular ??= world.teleop.turn;
    $('pad-speed').max = Math.max(1, ...[world.limits.max_vel_x, world.limits.max_vel_trans].filter((v) => v !== null && v < 5));
  }

  toggle() {
    this.on = !this.on;
    this.release();
    $('drive').hidden = !this.on;
    document.body.classList.toggle('driving', this.on);
    if (this.on) requestAnimationFrame(() => this.poll());
    if (this.on && matchMedia('(max-width: 760px)').matches && !document.body.classList.contains('no-panel')) this.app.togglePanel(); // it covers the pad
    if (this.app.camera.fitted) this.app.fit(); // on a phone the map makes room for the pad
    this.app.changed();
  }

  hint() { return matchMedia('(pointer: coarse)').matches ? 'Drag the knob: up drives, to the side turns. Let go to stop.' : 'Driving by hand: the pad, arrow keys, WASD, u i o / j k l / m , . or a game pad. Shift: sideways.'; }

  /** The texts of the pad. */
  update() {
    if (!this.on || this.linear === null) return;
    const text = `${this.linear.toFixed(2)} m/s, ${this.angular.toFixed(2)} rad/s`;
    if ($('pad-text').textContent !== text) { $('pad-text').textContent = text; $('pad-speed').value = this.linear; }
  }

  /** Handles a key; true if it was one of driving. */
  key(event) {
    if (!this.on || event.ctrlKey || event.metaKey || event.altKey) return false;
    if (DIRECTIONS[event.code]) {
      if (event.code.startsWith('Arrow') && event.target.closest?.('input, select, [role="tab"], [role="separator"]')) return false;
      this.down.set(event.code, event.shiftKey);
      this.follow();
      return true;
    }
    const speed = this.keys.speeds[event.key];
    if (speed) { // stops, as in the terminal
      this.release();
      this.linear = Math.min(20, this.linear * speed[0]);
      this.angular = Math.min(20, this.angular * speed[1]);
      this.app.changed();
      return true;
    }
    if (event.key === 'k' || event.key === 'K') { this.release(); return true; }
    if (!this.keys.moves[event.key]?.some((sign) => sign !== 0)) return false;
    this.held = event.key;
    this.follow();
    return true;
  }

  /** The pad: a finger or the mouse holds the knob. */
  listen(pad, knob) {
    const move = (event) => {
      const box = pad.getBoundingClientRect(), radius = box.width / 2;
      const right = (event.clientX - box.left) / radius - 1, down = (event.clientY - box.top) / radius - 1, length = Math.max(1, Math.hypot(right, down));
      this.stick = [-down / length, -right / length].map((v) => (Math.abs(v) < 0.12 ? 0 : Math.round(v * 20) / 20));
      knob.style.transform = `translate(${right / length * radius * 0.66}px, ${down / length * radius * 0.66}px)`;
      this.follow();
    };
    const end = () => { this.stick = null; knob.style.transform = ''; this.follow(); };
    pad.addEventListener('pointerdown', (event) => { event.preventDefault(); pad.setPointerCapture(event.pointerId); move(event); });
    pad.addEventListener('pointermove', (event) => { if (this.stick) move(event); });
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) pad.addEventListener(name, end);
  }

  /** Reads the game pads while driving by hand is on. */
  poll() {
    if (!this.on) { this.sticks = null; return; }
    const pad = (navigator.getGamepads?.() ?? []).find((item) => item?.connected), before = this.sticks;
    const axis = (index) => { const v = pad?.axes[index] ?? 0; return Math.abs(v) < DEAD_ZONE ? 0 : Math.round(v * 20) / 20; };
    // left stick: forward and turning; right stick: turning, with the left one sideways where the robot can
    const sideways = this.app.store.world?.holonomic ? -axis(0) : 0;
    const sticks = [-axis(1), sideways, sideways || axis(2) ? -axis(2) : this.app.store.world?.holonomic ? 0 : -axis(0)];
    this.sticks = sticks.some((v) => v !== 0) ? sticks : null;
    if (this.sticks || before) this.follow();
    requestAnimationFrame(() => this.poll());
  }

  /** What is asked for: [x, y, turn] as shares of the speeds, or null. */
  get wanted() {
    if (!this.on) return null;
    if (this.held) return this.keys.moves[this.held];
    if (this.down.size) {
      const sum = [0, 0, 0], holonomic = this.app.store.world?.holonomic;
      for (const [code, shift] of this.down) {
        sum[0] += DIRECTIONS[code][0];
        sum[shift && holonomic ? 1 : 2] += DIRECTIONS[code][1];
      }
      return sum.map((v) => Math.max(-1, Math.min(1, v)));
    }
    if (this.stick) return [this.stick[0], 0, this.stick[1]];
    return this.sticks;
  }

  /** Begins, goes on or stops, as the keys and sticks say. */
  follow() {
    const wanted = this.wanted;
    if (!wanted) { if (this.timer) this.stop(); return; }
    const key = wanted.join();
    if (this.timer && (key === this.sent || performance.now() < this.last + SOONEST_MS)) return;
    clearInterval(this.timer);
    this.timer = setInterval(() => this.drive(), REPEAT_MS);
    this.drive();
  }

  /** Simulated seconds until the next message, with some more. */
  get seconds() { return Math.min(2, SECONDS * Math.max(1, this.app.store.main?.speed ?? Infinity)); }

  drive() {
    const wanted = this.wanted;
    if (!wanted || !this.app.connection.open) { this.release(true); return; }
    const [x, y, turn] = wanted;
    this.sent = wanted.join();
    this.last = performance.now();
    this.app.connection.request({ type: 'drive', velocity: [x * this.linear, y * this.linear, turn * this.angular], seconds: this.seconds })
      .catch((error) => { this.release(true); this.app.toast(error.message, 'error'); });
  }

  stop(silent = false) {
    clearInterval(this.timer);
    this.timer = this.sent = null;
    if (!silent && this.app.connection.open) this.app.connection.request({ type: 'drive', velocity: [0, 0, 0], seconds: 0.1 }).catch(() => {});
  }

  /** Lets go of everything. */
  release(silent = false) {
    this.held = this.stick = this.sticks = null;
    this.down.clear();
    $('knob').style.transform = '';
    if (this.timer) this.stop(silent);
  }
}
