// The keys of teleop_twist_keyboard. The robot stops when the key is released, the page loses the focus or the connection breaks.
const MOVES = { // x, y, th
  i: [1, 0, 0], o: [1, 0, -1], j: [0, 0, 1], l: [0, 0, -1], u: [1, 0, 1], ',': [-1, 0, 0], '.': [-1, 0, 1], m: [-1, 0, -1], k: [0, 0, 0],
  I: [1, 0, 0], O: [1, -1, 0], J: [0, 1, 0], L: [0, -1, 0], U: [1, 1, 0], '<': [-1, 0, 0], '>': [-1, -1, 0], M: [-1, 1, 0], K: [0, 0, 0],
};
const SPEEDS = { q: [1.1, 1.1], z: [0.9, 0.9], w: [1.1, 1], x: [0.9, 1], e: [1, 1.1], c: [1, 0.9] };
const REPEAT_MS = 150, SECONDS = 0.5;

export class Teleop {
  constructor(app) {
    this.app = app;
    this.on = false;
    this.linear = 0.3; // m/s
    this.angular = 0.8; // rad/s
    this.held = null;
    addEventListener('blur', () => this.release());
    addEventListener('keyup', (event) => { if (this.held && event.key.toLowerCase() === this.held.toLowerCase()) this.release(); });
  }

  toggle() {
    this.on = !this.on;
    this.release();
    this.app.changed();
  }

  hint() { return `Driving by hand: u i o / j k l / m , . (Shift: sideways); speed ${this.linear.toFixed(2)} m/s, ${this.angular.toFixed(2)} rad/s (q z w x e c)`; }

  /** Handles a key; true if it was one of driving. */
  key(event) {
    if (!this.on || event.ctrlKey || event.metaKey || event.altKey) return false;
    const speed = SPEEDS[event.key];
    if (speed) {
      this.linear = Math.min(5, Math.max(0.02, this.linear * speed[0]));
      this.angular = Math.min(5, Math.max(0.05, this.angular * speed[1]));
      this.app.changed();
      return true;
    }
    if (!(event.key in MOVES)) return false;
    if (!event.repeat) this.press(event.key);
    return true;
  }

  press(key) {
    this.release(true);
    this.held = key;
    this.drive();
    this.timer = setInterval(() => this.drive(), REPEAT_MS);
  }

  drive() {
    const [x, y, turn] = MOVES[this.held];
    if (!this.app.connection.open) { this.release(true); return; }
    this.app.connection.request({ type: 'drive', velocity: [x * this.linear, y * this.linear, turn * this.angular], seconds: SECONDS })
      .catch((error) => { this.release(true); this.app.toast(error.message, 'error'); });
  }

  release(silent = false) {
    clearInterval(this.timer);
    if (this.held && !silent && this.app.connection.open) {
      this.app.connection.request({ type: 'drive', velocity: [0, 0, 0], seconds: 0.1 }).catch(() => {});
    }
    this.held = null;
  }
}
