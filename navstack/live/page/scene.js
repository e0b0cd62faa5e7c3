// Draws the map, the layers and the robot of one or two sessions on a canvas.
import { COSTMAPS, potentialTable, score } from './colors.js';
import { nextNumber } from './dom.js';
import { Grid } from './grid.js';

const POTENTIAL = potentialTable();

export class Scene {
  /** `view`: which robot the canvas shows when two robots are side by side. */
  constructor(canvas, store, camera, layers, theme, view = 0) {
    Object.assign(this, { canvas, store, camera, layers, theme, view });
    this.alone = false; // one robot per canvas
    this.context = canvas.getContext('2d');
    this.map = new Grid();
    this.frames = 0;
    this.refit = null; // shows the whole map again
    this.graph = null; // function(scene, side) that draws the route graph
    this.fan = null; // function(scene, side) that draws the trajectories of an answer
    this.overlay = null; // function(scene, context, size of a pixel) of the tools
    this.front = null; // the robot whose scans, obstacles and trajectories are drawn
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  resize() {
    const ratio = this.ratio = window.devicePixelRatio || 1, box = this.canvas.getBoundingClientRect();
    if (!box.width) return; // hidden
    this.canvas.width = Math.max(1, Math.round(box.width * ratio));
    this.canvas.height = Math.max(1, Math.round(box.height * ratio));
    const { width: before, height } = this.camera;
    this.camera.resize(box.width, box.height);
    if (this.extent && (!this.camera.set || before <= 1)) this.camera.fit(this.extent);
    else if (this.camera.fitted && box.height !== height) this.refit?.(); // a sheet that opens below covers nothing
    this.needed = true;
  }

  loadMap() {
    const { map, cells } = this.store.world;
    this.map.clear();
    const bytes = new Uint8Array(cells.length);
    for (let i = 0; i < cells.length; i++) bytes[i] = cells[i] < 0 ? 255 : cells[i];
    this.map.update({ ...map, box: [0, 0, map.nx, map.ny], blob: 0 }, [bytes.buffer]);
    const width = map.nx * map.resolution, height = map.ny * map.resolution;
    const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([u, v]) => [
      map.origin[0] + Math.cos(map.yaw) * u - Math.sin(map.yaw) * v, map.origin[1] + Math.sin(map.yaw) * u + Math.cos(map.yaw) * v]);
    const xs = corners.map((c) => c[0]), ys = corners.map((c) => c[1]);
    this.extent = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    this.camera.fit(this.extent);
  }

  draw(now) {
    const { context: c, camera, ratio, theme, store } = this;
    this.frames++;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.fillStyle = theme.mapOutside;
    c.fillRect(0, 0, camera.width, camera.height);
    if (!store.world) return;
    // meters, y up
    c.setTransform(ratio * camera.scale, 0, 0, -ratio * camera.scale, ratio * (camera.width / 2 - camera.x * camera.scale), ratio * (camera.height / 2 + camera.y * camera.scale));
    this.px = 1 / camera.scale;
    this.layer('map', () => this.drawMap());
    const sides = store.sides.filter((side) => side.pose && (!this.alone || side.index === this.view));
    this.front = sides.find((side) => side === store.main) ?? sides[0];
    if (this.front) this.drawGrids(this.front);
    this.layer('graph', () => this.graph?.(this, this.front));
    for (const side of [...sides.filter((other) => other !== this.front), ...(this.front ? [this.front] : [])]) this.drawSide(side, now);
    for (const side of sides) this.fan?.(this, side);
    this.overlay?.(this, c, this.px);
  }

  layer(name, draw) {
    const layer = this.layers.get(name);
    if (!layer.on) return;
    this.context.globalAlpha = layer.opacity;
    draw();
    this.context.globalAlpha = 1;
  }

  image(grid, table, [x, y], yaw, smooth = false) {
    const image = grid.canvas(table), c = this.context;
    if (!image) return;
    c.save();
    c.translate(x, y);
    c.rotate(yaw);
    c.imageSmoothingEnabled = smooth;
    c.drawImage(image, 0, 0, grid.nx * grid.resolution, grid.ny * grid.resolution);
    c.restore();
  }

  drawMap() {
    const { theme } = this;
    if (this.mapTheme !== theme.version) {
      this.mapTheme = theme.version;
      const free = theme.pixel('mapFree'), wall = theme.pixel('mapWall'), unknown = theme.pixel('mapUnknown');
      this.mapTable = new Uint32Array(256);
      for (let value = 0; value <= 100; value++) this.mapTable[value] = value >= 65 ? wall : value <= 25 ? free : unknown;
      for (let value = 101; value < 256; value++) this.mapTable[value] = unknown;
    }
    this.image(this.map, this.mapTable, this.store.world.map.origin, this.store.world.map.yaw);
  }

  drawGrids(side) {
    const table = COSTMAPS[this.layers.scheme], c = this.context;
    this.layer('global', () => side.grids.global.cells && this.image(side.grids.global, table, side.grids.global.origin, 0));
    this.layer('potential', () => side.grids.potential.cells && this.image(side.grids.potential, POTENTIAL, side.grids.potential.origin, 0, true));
    this.layer('local', () => {
      const grid = side.grids.local;
      if (!grid.cells) return;
      c.save();
      this.toOdom(side);
      this.image(grid, table, grid.origin, 0);
      c.strokeStyle = this.theme.muted;
      c.lineWidth = this.px;
      c.strokeRect(...grid.origin, grid.nx * grid.resolution, grid.ny * grid.resolution);
      c.restore();
    });
  }

  toOdom(side) { this.context.translate(side.odom[0], side.odom[1]); this.context.rotate(side.odom[2]); }

  line(points, color, width, dash = []) {
    const c = this.context;
    if (points.length < 4) return;
    c.beginPath();
    c.moveTo(points[0], points[1]);
    for (let i = 2; i < points.length; i += 2) c.lineTo(points[i], points[i + 1]);
    c.setLineDash(dash.map((d) => d * this.px));
    Object.assign(c, { strokeStyle: color, lineWidth: width * this.px, lineJoin: 'round', lineCap: 'round' });
    c.stroke();
    c.setLineDash([]);
  }

  drawSide(side, now) {
    const { theme, context: c } = this, color = side.index ? theme.robot2 : theme.plan;
    this.layer('trail', () => this.line([...side.trail.flat(), ...side.pose.slice(0, 2)], side.index ? theme.robot2 : theme.trail, 2, [1, 5]));
    this.layer('former', () => side.plans.slice(0, -1).forEach(([, points], i) => { c.globalAlpha *= 0.35 + 0.1 * i; this.line(points, color, 1.2); }));
    this.layer('plan', () => side.goals.under_way.length && side.plans.length && this.line(side.plans.at(-1)[1], color, 3));
    if (side === this.front) this.layer('trajectories', () => this.drawTrajectories(side));
    this.layer('trajectory', () => {
      if (!side.trajectory || !side.goals.under_way.length) return;
      c.save();
      this.toOdom(side);
      this.line(side.trajectory, theme.trajectory, 3.5);
      c.restore();
    });
    if (side === this.front) { this.drawShapes(side); this.layer('scan', () => this.drawScan(side)); }
    this.layer('footprint', () => this.drawOthers(side));
    this.layer('goals', () => this.drawGoals(side));
    for (const [layer, part] of [['padded', 'drawPadded'], ['footprint', 'drawRobot']]) this.layer(layer, () => this.atRobot(side, now, part));
  }

  drawTrajectories(side) {
    const t = side.trajectories, c = this.context;
    if (!t) return;
    const legal = t.scores.filter((s) => !Number.isNaN(s)), low = Math.min(...legal), high = Math.max(...legal);
    c.save();
    this.toOdom(side);
    c.translate(...t.origin);
    for (const wanted of [true, false]) {
      for (let row = 0; row < t.rows; row++) {
        const value = t.scores[row], rejected = Number.isNaN(value);
        if (rejected !== wanted || row === t.best) continue;
        const points = Array.from(t.xy.subarray(row * t.points * 2, (row + 1) * t.points * 2), (v) => v / 100);
        if (rejected) this.line(points, this.theme.bad, 0.9, [2, 4]);
        else this.line(points, score(high > low ? (value - low) / (high - low) : 0, this.layers.scheme), 1.3);
      }
    }
    c.restore();
  }

  drawScan(side) {
    const c = this.context, { pose, points } = side.scan ?? {};
    if (!points) return;
    const size = Math.max(2.6 * this.px, 0.02), cos = Math.cos(pose[2]), sin = Math.sin(pose[2]);
    c.fillStyle = this.theme.scan;
    for (let i = 0; i < points.length; i += 2) {
      const u = points[i] / 100, v = points[i + 1] / 100;
      c.fillRect(pose[0] + cos * u - sin * v - size / 2, pose[1] + sin * u + cos * v - size / 2, size, size);
    }
  }

  /** Outline of a shape in the map: { circle: [x, y, r] } or { points: [x, y, ..] }. */
  outline(side, shape) {
    const disc = side.discs?.find((d) => d[0] === shape.name), polygon = side.polygons?.find((p) => p[0] === shape.name);
    if (disc && side.movesNow) return { circle: disc.slice(1) };
    if (polygon && side.movesNow) return { points: polygon.slice(1) };
    const [x, y, yaw] = shape.pose;
    if (shape.radius) return { circle: [x, y, shape.radius] };
    const cos = Math.cos(yaw), sin = Math.sin(yaw);
    return { points: shape.outline.flatMap(([u, v]) => [x + cos * u - sin * v, y + sin * u + cos * v]) };
  }

  drawShapes(side) {
    side.movesNow = side.discs.length + side.polygons.length > 0 && side.shapes.some((s) => s.kind !== 'still');
    for (const shape of side.shapes) {
      if (shape.kind === 'replay' && !side.discs.some((d) => d[0] === shape.name)) continue; // absent
      const name = shape.kind === 'still' || shape.kind === 'track' ? 'shapes' : 'people';
      this.layer(name, () => this.drawShape(this.outline(side, shape), shape.kind, shape.name === this.selected));
    }
  }

  drawShape(outline, kind, selected) {
    const c = this.context, person = kind === 'pedestrian' || kind === 'replay';
    c.beginPath();
    if (outline.circle) c.arc(...outline.circle, 0, 2 * Math.PI);
    else { outline.points.forEach((v, i) => i % 2 && (i === 1 ? c.moveTo(outline.points[0], v) : c.lineTo(outline.points[i - 1], v))); c.closePath(); }
    c.fillStyle = person ? `${this.theme.person}99` : this.theme.shapeFill;
    c.fill();
    Object.assign(c, { strokeStyle: selected ? this.theme.accent : person ? this.theme.person : this.theme.shape, lineWidth: (selected ? 3 : 1.6) * this.px });
    c.stroke();
    if (person) { c.beginPath(); c.arc(outline.circle[0], outline.circle[1], outline.circle[2] * 0.4, 0, 2 * Math.PI); c.fillStyle = this.theme.person; c.fill(); }
  }

  /** The other robots of a fleet: footprint, heading, name; one that waits is pale. */
  drawOthers(side) {
    const c = this.context, { theme, px } = this;
    for (const [name, x, y, yaw, waits] of side.robots) {
      const polygon = side.polygons.find((p) => p[0] === name);
      if (!polygon) continue;
      const points = polygon.slice(1), radius = Math.max(...points.map((v, i) => Math.abs(v - (i % 2 ? y : x))));
      c.save();
      c.globalAlpha *= waits ? 0.45 : 1;
      c.beginPath();
      points.forEach((v, i) => i % 2 && (i === 1 ? c.moveTo(points[0], v) : c.lineTo(points[i - 1], v)));
      c.closePath();
      Object.assign(c, { fillStyle: theme.robot2, strokeStyle: theme.text, lineWidth: 1.4 * px });
      c.fill();
      c.stroke();
      c.beginPath();
      c.moveTo(x, y);
      c.lineTo(x + Math.cos(yaw) * radius, y + Math.sin(yaw) * radius);
      c.stroke();
      c.restore();
      if (radius > 6 * px) this.text(name, x, y + radius + 9 * px, theme.text, 10);
    }
  }

  arrow([x, y, yaw], color, label, { hollow = false, size = 15 } = {}) {
    const c = this.context, px = this.px;
    c.save();
    c.translate(x, y);
    c.rotate(yaw);
    c.beginPath();
    c.arc(0, 0, size * 0.42 * px, 0, 2 * Math.PI);
    Object.assign(c, { lineWidth: 2.2 * px, strokeStyle: color, fillStyle: hollow ? this.theme.surface : color });
    c.fill();
    c.stroke();
    c.beginPath();
    c.moveTo(size * 0.42 * px, 0);
    c.lineTo(size * 1.5 * px, 0);
    c.moveTo(size * 1.1 * px, size * 0.32 * px);
    c.lineTo(size * 1.55 * px, 0);
    c.lineTo(size * 1.1 * px, -size * 0.32 * px);
    c.stroke();
    c.restore();
    if (!label) return;
    // behind the marker, with room for half the text (7 px per letter) in that direction
    const away = (size * 0.42 + 6 + Math.abs(Math.cos(yaw)) * label.length * 3.5 + Math.abs(Math.sin(yaw)) * 7) * px;
    this.text(label, x - Math.cos(yaw) * away, y - Math.sin(yaw) * away, color);
  }

  text(text, x, y, color, size = 12) {
    const c = this.context;
    c.save();
    c.translate(x, y);
    c.scale(this.px, -this.px);
    c.font = `600 ${size}px system-ui, "DejaVu Sans", sans-serif`;
    c.textAlign = 'center';
    Object.assign(c, { lineWidth: 3, strokeStyle: this.theme.surface, fillStyle: color, lineJoin: 'round' });
    c.strokeText(text, 0, 4);
    c.fillText(text, 0, 4);
    c.restore();
  }

  drawGoals(side) {
    const { goals } = side, color = side.index ? this.theme.robot2 : this.theme.goal;
    if (side === this.front) {
      goals.ended.slice(-12).forEach((goal) => this.arrow(goal.pose, goal.state === 'SUCCEEDED' ? this.theme.muted : this.theme.bad, goal.state === 'SUCCEEDED' ? '✓' : '✕', { hollow: true, size: 11 }));
      const first = goals.under_way.at(-1)?.pose ?? side.pose;
      this.context.globalAlpha *= 0.6;
      this.line([first, ...goals.waiting].flatMap((p) => p.slice(0, 2)), color, 1.4, [4, 5]);
      goals.waiting.forEach((pose, i) => this.arrow(pose, color, String(nextNumber(goals) + i), { hollow: true }));
      this.context.globalAlpha /= 0.6;
    }
    for (const goal of goals.under_way) this.arrow(goal.pose, color, `goal ${goal.number}`, { size: 17 });
  }

  polygon(vertices) {
    const c = this.context;
    c.beginPath();
    vertices.forEach(([x, y], i) => (i ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.closePath();
  }

  atRobot(side, now, part) {
    const c = this.context, [x, y, yaw] = side.poseAt(now);
    c.save();
    c.translate(x, y);
    c.rotate(yaw);
    this[part](side);
    c.restore();
  }

  drawPadded(side) {
    const c = this.context;
    if (!side.padded?.length) return;
    this.polygon(side.padded);
    Object.assign(c, { strokeStyle: this.theme.text, lineWidth: this.px });
    c.setLineDash([3 * this.px, 3 * this.px]);
    c.stroke();
    c.setLineDash([]);
  }

  drawRobot(side) {
    const c = this.context, { footprint } = this.store.world;
    this.polygon(footprint);
    Object.assign(c, { fillStyle: side.index ? this.theme.robot2 : this.theme.robot, strokeStyle: side.collisions ? this.theme.bad : this.theme.robotEdge, lineWidth: 1.6 * this.px });
    c.fill();
    c.stroke();
    const front = Math.max(...footprint.map(([x]) => x));
    c.beginPath();
    c.moveTo(front * 0.85, 0);
    c.lineTo(front * 0.05, front * 0.38);
    c.lineTo(front * 0.05, -front * 0.38);
    c.closePath();
    c.fillStyle = this.theme.robotEdge;
    c.fill();
    const half = 0.125 * (this.store.world.wheelbase ?? 0);
    for (const [x, y, direction] of side.wheels ?? []) {
      c.beginPath();
      c.moveTo(x - half * Math.cos(direction), y - half * Math.sin(direction));
      c.lineTo(x + half * Math.cos(direction), y + half * Math.sin(direction));
      Object.assign(c, { strokeStyle: this.theme.text, lineWidth: Math.max(2.5 * this.px, 0.2 * half) });
      c.stroke();
    }
  }
}
