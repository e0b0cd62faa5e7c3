// The time line: where the session is, what was done when, and going back.
import { $ } from './dom.js';

const KINDS = { goal: 'goal', queue: 'goal', cancel: 'goal', put: 'shape', remove: 'shape', set: 'accent', drive: 'robot', place: 'robot' };

export class Timeline {
  constructor(app) {
    this.app = app;
    this.slider = $('timeline');
    this.slider.addEventListener('input', () => this.seek(Number(this.slider.value)));
    this.slider.addEventListener('change', () => { this.held = false; });
  }

  /** Goes to a time; while one request is under way, only the latest one waits. */
  async seek(time) {
    this.held = true;
    this.next = Math.max(0, time);
    if (this.busy) return;
    this.busy = true;
    while (this.next !== null) {
      const target = this.next;
      this.next = null;
      try { await this.app.connection.request({ type: 'seek', time: target }); } catch (error) { this.app.toast(error.message, 'error'); }
    }
    this.busy = false;
    this.held = false;
  }

  update(side, clock) {
    const end = Math.max(side.end, 0.001);
    if (this.end !== end) { this.end = end; this.slider.max = end; }
    if (!this.held) this.slider.value = clock;
    this.slider.title = `${clock.toFixed(1)} of ${end.toFixed(1)} s`;
    const key = `${end} ${side.interactions.length} ${this.app.theme.version}`;
    if (key !== this.drawn) { this.drawn = key; this.draw(side, end); }
  }

  draw(side, end) {
    const canvas = $('marks'), ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    const c = canvas.getContext('2d');
    for (const [time, kind] of side.interactions) {
      c.fillStyle = this.app.theme[KINDS[kind] ?? 'muted'];
      c.fillRect(8 * ratio + (time / end) * (canvas.width - 16 * ratio) - ratio, 0, 2 * ratio, canvas.height);
    }
  }
}
