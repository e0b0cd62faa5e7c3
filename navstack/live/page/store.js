// What the page knows of the session: frames are differences, so everything is kept here.
import { Grid } from './grid.js';

const SAMPLES = 3000, EVENTS = 400, PLANS = 6;

export class Side {
  constructor(index) {
    this.index = index;
    this.padded = [];
    this.grids = { global: new Grid(), local: new Grid(), potential: new Grid() };
    this.reset();
  }

  reset() {
    Object.assign(this, {
      samples: [], events: [], plans: [], trail: [], trajectory: null, trajectories: null, scan: null, camera: null, discs: [], polygons: [], robots: [],
      goals: { under_way: [], waiting: [], loop: false, ended: [] }, shapes: [], interactions: [], behavior_tree: null, tree_states: null, before: null, t: 0, end: 0,
    });
    for (const grid of Object.values(this.grids)) grid.clear();
  }

  apply(entries, blobs, now) {
    if (this.restarts !== undefined && entries.restarts !== this.restarts) this.reset();
    const before = this.pose ? { t: this.t, pose: this.pose } : null;
    const { samples, events, plans, costmaps, potential, scan, camera, trajectories, trail, ...rest } = entries;
    if (before && rest.t > before.t) this.before = before;
    else if (!before || rest.t < before.t) this.before = null;
    Object.assign(this, rest);
    this.received = now;
    if (samples) { this.samples.push(...samples); this.samples.splice(0, this.samples.length - SAMPLES); }
    if (events) { this.events.push(...events); this.events.splice(0, this.events.length - EVENTS); }
    if (plans) { this.plans.push(...plans); this.plans.splice(0, this.plans.length - PLANS); }
    if (trail) this.trail = trail;
    if (scan !== undefined) this.scan = { pose: rest.pose, points: new Int16Array(blobs[scan]) };
    if (camera) this.camera = { width: camera.nx, height: camera.ny, rgb: new Uint8Array(blobs[camera.blob]) };
    if ('trajectories' in entries) {
      this.trajectories = trajectories && {
        ...trajectories, xy: new Int16Array(blobs[trajectories.blob]), scores: new Float32Array(blobs[trajectories.scores]),
        samples: new Uint16Array(blobs[trajectories.samples]), t: rest.t,
      };
    }
    for (const [name, change] of Object.entries(costmaps ?? {})) this.grids[name].update(change, blobs);
    if (potential) { this.grids.potential.clear(); this.grids.potential.update({ ...potential, box: [0, 0, potential.nx, potential.ny] }, blobs); }
  }

  /** Simulated time to show (s): even between the last two cycles. */
  clockAt(now) {
    if (this.paused || this.done || this.seeking || this.speed === null || !this.before) return this.t;
    return Math.min(this.t, this.clock + (now - this.received) / 1000 * this.speed);
  }

  /** Pose of the robot to show. */
  poseAt(now) {
    const before = this.before, t = this.clockAt(now);
    if (!before || t >= this.t || this.t - before.t > 1.5) return this.pose;
    const u = Math.max(0, (t - before.t) / (this.t - before.t));
    const turn = Math.atan2(Math.sin(this.pose[2] - before.pose[2]), Math.cos(this.pose[2] - before.pose[2]));
    return [before.pose[0] + u * (this.pose[0] - before.pose[0]), before.pose[1] + u * (this.pose[1] - before.pose[1]), before.pose[2] + u * turn];
  }

  /** True while the picture changes between two frames. */
  get moving() { return !(this.paused || this.done || this.seeking || this.speed === null) && !!this.before; }
}

export class Store {
  constructor() { this.world = null; this.sides = []; this.version = 0; this.chosen = 0; }

  /** The robot that the panel is about. */
  get main() { return this.sides[this.chosen]; }

  frame(header, blobs, now) {
    if (header.type === 'world') {
      const map = header.map;
      this.world = { ...header, cells: new Int8Array(blobs[map.blob]) };
      this.sides = header.labels.map((_, index) => new Side(index));
      this.sides.forEach((side, index) => { side.padded = header.padded[index]; });
      if (this.chosen >= this.sides.length) this.chosen = 0;
    } else {
      header.sides.forEach((entries, index) => this.sides[index]?.apply(entries, blobs, now));
    }
    this.version++;
  }
}
