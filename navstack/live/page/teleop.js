// Driving by hand with the keys of `navstack teleop`, which the server names. The robot stops when the key is released, the page loses the focus or the connection breaks.
const REPEAT_MS = 150, SECONDS = 0.5;

export class Teleop {
  constructor(app) {
    this.app = app;
    this.on = false;
    this.keys = { moves: {}, speeds: {} };
    this.linear = this.angular = null; // m/s, rad/s
    this.held = null;
    addEventListener('blur', () => this.release());
    addEventListener('keyup', (event) => { if (this.held && event.key.toLowerCase() === this.held.toLowerCase()) this.release(); });
  }

  world(world) {
    this.keys = world.teleop;
    this.linear ??= world.teleop.speed;
    this.angular ??= world.teleop.turn;
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
    if (!event.repeat) this.press(event.key);
    return true;
  }

  press(key) {
    this.release(true);
    this.held = key;
    this.drive();
    this.timer = setInterval(() => this.drive(), REPEAT_MS);
  }

  /** Simulated seconds until the next message, with some more. */
  get seconds() { return Math.min(2, SECONDS * Math.max(1, this.app.store.main?.speed ?? Infinity)); }

  drive() {
    const [x, y, turn] = this.keys.moves[this.held];
    if (!this.app.connection.open) { this.release(true); return; }
    this.app.connection.request({ type: 'drive', velocity: [x * this.linear, y * this.linear, turn * this.angular], seconds: this.seconds })
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
