// What pointers and keys do on the map: goals, poses, obstacles, questions; panning and zooming.
import { $, button, el } from './dom.js';

export const TOOLS = [
  ['why', 'Ask and select (V)', 'v', 'Click a cell, a trajectory or a goal: why. Drag an obstacle to move it, drag the map to pan.'],
  ['goal', 'Goal (G)', 'g', 'Press, and drag for the heading. With Shift the goal joins the queue.'],
  ['pose', 'Put the robot here (R)', 'r', 'Press, and drag for the heading: the robot is put there, and its localization is set to the pose.'],
  ['passage', 'Can the robot pass? (Y)', 'y', 'Click an opening: can the robot pass?'],
  null,
  ['disc', 'Add a disc (D)', 'd', 'Press, and drag for the radius.'],
  ['box', 'Add a box (B)', 'b', 'Drag from corner to corner.'],
  ['wall', 'Add a wall (A)', 'a', 'Drag from end to end.'],
  ['person', 'Add a person (P)', 'p', 'Press, and drag to where the person walks.'],
  ['delete', 'Remove an obstacle (Delete)', 'Delete', 'Click an obstacle to remove it.'],
  ['erase', 'Erase walls in the saved map (E)', 'e', 'Drag over walls: they are missing in the map that you save (tab Layers).'],
  null,
  ['measure', 'Measure (M)', 'm', 'Drag: distance and direction.'],
  ['drive', 'Drive by hand (T)', 't', ''],
  ['graph', 'Route graph (W)', 'w', ''],
  ['copy', 'Copy a pose as x,y,yaw (C)', 'c', 'Press, and drag for the heading: copies x,y,yaw for the command line.'],
];
const CLICK_PX = 6, NEAR_PX = 12;
const POSES = ['goal', 'pose', 'copy'];
const ERASER_M = 0.3;
const COSTS = { 0: 'free', 253: 'inscribed', 254: 'lethal', 255: 'unknown' };

export class Tools {
  constructor(app) {
    this.app = app;
    this.tool = 'why';
    this.pointers = new Map();
    this.measured = null; // { x, y, x2, y2 }
    this.erased = []; // strokes: { points: [[x, y], ..], width }
    this.cross = null; // keyboard: { x, y, yaw }
    for (const item of TOOLS) {
      if (!item) { $('tools').append(el('hr')); continue; }
      const [name, label] = item;
      $('tools').append(button(name, label, () => this.choose(name), { id: `tool-${name}`, 'aria-pressed': 'false' }));
    }
    // on a phone the tools scroll: a faded edge shows that there are more
    const bar = $('tools'), fade = () => {
      bar.style.setProperty('--fade-left', bar.scrollLeft > 4 ? '28px' : '0px');
      bar.style.setProperty('--fade-right', bar.scrollLeft + bar.clientWidth < bar.scrollWidth - 4 ? '28px' : '0px');
    };
    bar.addEventListener('scroll', fade);
    new ResizeObserver(fade).observe(bar);
    this.canvas = $('scene'); // the one that was used last
    for (const scene of app.scenes) this.listen(scene);
    this.choose('why');
  }

  /** The buttons of the tab Layers that save the map. */
  buildActions() {
    const { app } = this;
    $('map-actions').append(
      el('button', { type: 'button', className: 'outline', id: 'save-map', title: 'The map with your obstacles that stand still, without what you erased', onclick: () => app.save.open('map', 'Save as a map', { erased: this.erased }) }, 'Save as map'),
      el('button', { type: 'button', className: 'outline', id: 'undo-erase', onclick: () => { this.erased.pop(); app.changed(); } }, 'Undo erasing'));
  }

  /** The cost of the cell at a point of the map, in the costmap that is seen there. */
  costText(side, x, y) {
    const { layers } = this.app, local = layers.get('local').on ? side.grids.local.at(...toOdom(side, x, y)) : null, cost = local ?? side.grids.global.at(x, y);
    return cost === null ? '' : ` · ${local === null ? 'global' : 'local'} ${COSTS[cost] ? `${COSTS[cost]} (${cost})` : `cost ${cost}`}`;
  }

  listen(scene) {
    const { canvas } = scene, { app } = this, on = (name, action, options) => canvas.addEventListener(name, action, options);
    on('pointerdown', (e) => { this.canvas = canvas; this.down(e, scene); });
    on('pointermove', (e) => { if (!this.pointers.size) this.canvas = canvas; this.move(e); });
    on('pointerup', (e) => this.up(e));
    on('pointercancel', (e) => { this.pointers.delete(e.pointerId); this.drag = null; app.changed(); });
    on('pointerleave', () => { this.pointer = null; app.changed(); });
    on('contextmenu', (e) => e.preventDefault());
    on('wheel', (e) => { e.preventDefault(); app.camera.zoom(1.0015 ** -e.deltaY, e.offsetX, e.offsetY); app.changed(); }, { passive: false });
    scene.overlay = (where, context, px) => this.draw(where, context, px);
  }

  choose(name) {
    if (name === 'drive') { this.app.teleop.toggle(); } else this.tool = name;
    for (const item of TOOLS) if (item) $(`tool-${item[0]}`).setAttribute('aria-pressed', String(item[0] === 'drive' ? this.app.teleop.on : item[0] === this.tool));
    this.drag = null;
    if (name === 'graph') this.app.showPanel('graph'); // its buttons are there
    this.app.changed();
  }

  hint() {
    if (this.app.teleop.on) return this.app.teleop.hint();
    if (this.tool === 'graph') return this.app.graph.hint();
    return TOOLS.find((item) => item?.[0] === this.tool)[3];
  }

  at(event) { const box = this.canvas.getBoundingClientRect(); return this.app.camera.toMap(event.clientX - box.left, event.clientY - box.top); }

  down(event, scene) {
    if (scene.alone && this.tool === 'why') this.app.versus.choose(scene.view); // questions are about the robot that is shown there
    this.canvas.setPointerCapture?.(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (this.pointers.size === 2) { this.drag = null; this.pinch = this.spread(); return; }
    if (this.pointers.size > 2) return;
    const [x, y] = this.at(event), pan = event.button === 1 || event.button === 2;
    const shape = pan ? null : this.shapeAt(x, y);
    const touch = event.pointerType === 'touch', graph = this.tool === 'graph';
    const kind = graph && !pan ? (this.app.graph.takes(x, y, touch) ? 'graph' : 'pan') : pan || (this.tool === 'why' && !(shape && this.canMove(shape))) ? 'pan' : this.tool === 'why' ? 'shape' : 'tool';
    const points = kind === 'tool' && this.tool === 'erase' ? [[x, y]] : null;
    this.measured = null;
    this.drag = { kind, touch, points, x, y, x2: x, y2: y, u: event.clientX, v: event.clientY, shape, moved: false, shift: event.shiftKey };
    this.cross = null;
    this.app.select(shape?.name ?? null);
    this.app.changed();
  }

  move(event) {
    this.pointer = this.at(event);
    const before = this.pointers.get(event.pointerId), drag = this.drag;
    if (before) this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (this.pointers.size === 2) { this.zoomByPinch(); return; }
    if (drag && before) {
      drag.moved ||= Math.hypot(event.clientX - drag.u, event.clientY - drag.v) > CLICK_PX;
      if (drag.kind === 'pan' && drag.moved) { this.app.camera.pan(event.clientX - before[0], event.clientY - before[1]); this.app.follow = false; }
      [drag.x2, drag.y2] = this.pointer;
      if (drag.points && Math.hypot(drag.x2 - drag.points.at(-1)[0], drag.y2 - drag.points.at(-1)[1]) > ERASER_M / 3) drag.points.push([drag.x2, drag.y2]);
      this.canvas.classList.toggle('pan', drag.kind === 'pan' && drag.moved);
    }
    this.app.changed();
  }

  up(event) {
    const drag = this.drag;
    this.pointers.delete(event.pointerId);
    this.canvas.classList.remove('pan');
    this.drag = null;
    this.app.changed();
    if (!drag) return;
    drag.shift ||= event.shiftKey;
    if (drag.kind === 'graph') this.app.graph.drop(drag);
    else if (drag.kind === 'pan' && !drag.moved && event.button === 0 && this.tool === 'graph') this.app.graph.click(drag.x, drag.y, drag.touch);
    else if (drag.kind === 'pan' && !drag.moved && event.button === 0) this.ask(drag.x, drag.y);
    else if (drag.kind === 'shape' && drag.moved) this.moveShape(drag.shape, drag.x2 - drag.x, drag.y2 - drag.y);
    else if (drag.kind === 'shape') this.ask(drag.x, drag.y);
    else if (drag.kind === 'tool') this.use(drag);
  }

  spread() {
    const [a, b] = [...this.pointers.values()];
    return { distance: Math.hypot(a[0] - b[0], a[1] - b[1]), u: (a[0] + b[0]) / 2, v: (a[1] + b[1]) / 2 };
  }

  zoomByPinch() {
    const now = this.spread(), box = this.canvas.getBoundingClientRect();
    if (this.pinch) {
      this.app.camera.pan(now.u - this.pinch.u, now.v - this.pinch.v);
      this.app.camera.zoom(now.distance / Math.max(this.pinch.distance, 1), now.u - box.left, now.v - box.top);
    }
    this.pinch = now;
    this.app.follow = false;
    this.app.changed();
  }

  // --- what a tool does ---------------------------------------------------------------------------------------------

  pose(drag) { return [drag.x, drag.y, drag.moved ? Math.atan2(drag.y2 - drag.y, drag.x2 - drag.x) : drag.yaw ?? this.defaultYaw(drag)]; }

  /** Heading of a click without a drag: from the robot to the goal. */
  defaultYaw(drag) {
    const pose = this.app.store.main?.pose;
    return pose && this.tool === 'goal' ? Math.atan2(drag.y - pose[1], drag.x - pose[0]) : 0;
  }

  use(drag) {
    const { app } = this, pose = this.pose(drag);
    switch (this.tool) {
      case 'goal': app.goal(pose, drag.shift); break;
      case 'pose': app.act({ type: 'place', pose }); break;
      case 'copy': app.copyPose(pose); break;
      case 'measure': this.measured = drag.moved ? drag : null; break;
      case 'erase': this.erased.push({ points: (drag.points ?? [[drag.x, drag.y]]).slice(0, 400).map((p) => p.map((v) => Math.round(v * 1000) / 1000)), width: ERASER_M }); break;
      case 'passage': app.why.passage(drag.x, drag.y); break;
      case 'delete': if (drag.shape) app.act({ type: 'remove', name: drag.shape.name }); else app.toast('There is no obstacle here; only obstacles that are not on the map can be removed.', 'warning'); break;
      default: app.act({ type: 'put', shape: { name: this.freeName(this.tool), ...this.shape(this.tool, drag) } });
    }
  }

  measureText({ x, y, x2, y2 }) { return `${Math.hypot(x2 - x, y2 - y).toFixed(2)} m, ${Math.round(Math.atan2(y2 - y, x2 - x) * 180 / Math.PI)}°`; }

  freeName(kind) {
    const names = new Set(this.app.store.main.shapes.map((shape) => shape.name));
    for (let number = 1; ; number++) if (!names.has(`${kind} ${number}`)) return `${kind} ${number}`;
  }

  shape(kind, { x, y, x2, y2, moved }) {
    const round = (v) => Math.round(v * 1000) / 1000;
    if (kind === 'disc') return { radius: moved ? Math.max(0.03, round(Math.hypot(x2 - x, y2 - y))) : 0.25, pose: [round(x), round(y), 0] };
    if (kind === 'box') {
      return moved ? { box: [Math.max(0.05, round(Math.abs(x2 - x))), Math.max(0.05, round(Math.abs(y2 - y)))], pose: [round((x + x2) / 2), round((y + y2) / 2), 0] }
        : { box: [0.5, 0.5], pose: [round(x), round(y), 0] };
    }
    if (kind === 'wall') {
      const [a, b] = moved ? [[x, y], [x2, y2]] : [[x - 0.5, y], [x + 0.5, y]];
      return { box: [Math.max(0.1, round(Math.hypot(b[0] - a[0], b[1] - a[1]))), 0.06], pose: [round((a[0] + b[0]) / 2), round((a[1] + b[1]) / 2), Math.atan2(b[1] - a[1], b[0] - a[0])] };
    }
    const goal = moved ? [round(x2), round(y2)] : [round(x + 3), round(y)];
    return { radius: 0.25, pose: [round(x), round(y), 0], motion: { kind: 'pedestrian', goals: [goal, [round(x), round(y)]] } };
  }

  canMove(shape) { return shape.kind === 'still' && !this.app.readOnly; }

  moveShape(shape, dx, dy) {
    const { name, radius, box, polygon, segment, pose, height } = shape;
    const values = Object.fromEntries(Object.entries({ name, radius, box, polygon, segment, height }).filter(([, v]) => v !== undefined));
    this.app.act({ type: 'put', shape: { ...values, pose: [pose[0] + dx, pose[1] + dy, pose[2] ?? 0] } });
  }

  shapeAt(x, y) {
    const side = this.app.store.main;
    if (!side) return null;
    const near = 4 / this.app.camera.scale;
    return [...side.shapes].reverse().find((shape) => {
      const outline = this.app.scene.outline(side, shape);
      if (outline.circle) return Math.hypot(x - outline.circle[0], y - outline.circle[1]) <= outline.circle[2] + near;
      return inside(outline.points, x, y);
    }) ?? null;
  }

  ask(x, y) {
    const { app } = this, side = app.store.main, near = NEAR_PX / app.camera.scale;
    if (!side) return;
    const goals = [...side.goals.under_way, ...[...side.goals.ended].reverse()];
    const robot = side.robots.find(([name]) => side.polygons.some((p) => p[0] === name && inside(p.slice(1), x, y)));
    if (robot) { app.showRobot(robot[0]); return; }
    const goal = app.layers.get('goals').on && goals.find((g) => Math.hypot(g.pose[0] - x, g.pose[1] - y) < near);
    if (goal) { app.why.goal(goal.number); return; }
    const sample = app.layers.get('trajectories').on ? this.sampleAt(side, x, y, near) : null;
    if (sample !== null) { app.why.sample(sample, side.trajectories.t); return; }
    const [u, v] = toOdom(side, x, y);
    app.why.cell(x, y, app.layers.get('local').on && side.grids.local.at(u, v) !== null ? 'local' : 'global');
  }

  /** Number of the trajectory whose end or line is nearest to a point; null if none is near. */
  sampleAt(side, x, y, near) {
    const t = side.trajectories;
    if (!t) return null;
    const [u, v] = toOdom(side, x, y);
    let best = near, found = null;
    for (let row = 0; row < t.rows; row++) {
      for (let k = 1; k < t.points; k++) {
        const i = (row * t.points + k) * 2, d = Math.hypot(t.origin[0] + t.xy[i] / 100 - u, t.origin[1] + t.xy[i + 1] / 100 - v);
        if (d < best) { best = d; found = t.samples[row]; }
      }
    }
    return found;
  }

  // --- keyboard -----------------------------------------------------------------------------------------------------

  /** Handles a key of the map; true if it was one. */
  key(event) {
    const tool = TOOLS.find((item) => item && (item[2] === event.key.toLowerCase() || item[2] === event.key));
    if (this.app.scenes.some((scene) => scene.canvas === event.target) && this.crossKey(event)) return true;
    if (event.key === 'Delete' && this.tool === 'graph') { this.app.graph.remove(); return true; }
    if (event.key === 'Delete' && this.app.scene.selected) { this.app.act({ type: 'remove', name: this.app.scene.selected }); this.app.select(null); return true; }
    if (tool) { this.choose(tool[0]); return true; }
    return false;
  }

  crossKey(event) {
    const { camera } = this.app, step = (event.shiftKey ? 5 : 0.5) * 20 / camera.scale;
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (event.key in moves) {
      this.cross ??= { x: camera.x, y: camera.y, yaw: 0 };
      this.cross.x += moves[event.key][0] * step;
      this.cross.y += moves[event.key][1] * step;
      const [u, v] = camera.toScreen(this.cross.x, this.cross.y);
      if (u < 30 || v < 30 || u > camera.width - 30 || v > camera.height - 30) { camera.x = this.cross.x; camera.y = this.cross.y; }
    } else if (event.key === '[' || event.key === ']') {
      this.cross ??= { x: camera.x, y: camera.y, yaw: 0 };
      this.cross.yaw += (event.key === '[' ? 1 : -1) * Math.PI / 12;
    } else if (event.key === 'Enter' && this.cross) {
      const { x, y, yaw } = this.cross;
      if (this.tool === 'why') this.ask(x, y);
      else if (this.tool === 'graph') this.app.graph.drop({ x, y, x2: x, y2: y, moved: false, touch: false });
      else this.use({ x, y, x2: x, y2: y, yaw, moved: false, shift: event.shiftKey, shape: this.shapeAt(x, y) });
    } else return false;
    this.pointer = this.cross && [this.cross.x, this.cross.y];
    this.app.changed();
    return true;
  }

  // --- preview ------------------------------------------------------------------------------------------------------

  draw(scene, context, px) {
    const { theme } = this.app, drag = this.drag;
    for (const { points, width } of [...this.erased, ...(drag?.points ? [{ points: drag.points, width: ERASER_M }] : [])]) {
      const flat = points.length > 1 ? points.flat() : [...points[0], points[0][0] + 1e-6, points[0][1]];
      context.globalAlpha = 0.85;
      scene.line(flat, theme.mapFree, width / px);
      context.globalAlpha = 1;
      scene.line(flat, theme.bad, 1, [3, 5]);
    }
    const ruler = drag?.kind === 'tool' && this.tool === 'measure' ? drag : this.measured;
    if (ruler) {
      const dx = ruler.x2 - ruler.x, dy = ruler.y2 - ruler.y, length = Math.hypot(dx, dy);
      scene.line([ruler.x, ruler.y, ruler.x2, ruler.y2], theme.accent, 2.5);
      if (length) scene.text(this.measureText(ruler), ruler.x2, ruler.y2 + 16 * px, theme.accent, 13);
    }
    if (drag?.kind === 'tool') {
      if (POSES.includes(this.tool)) scene.arrow(this.pose(drag), this.tool === 'pose' ? theme.robot : theme.accent, '', { size: 20 });
      else if (['disc', 'box', 'wall', 'person'].includes(this.tool)) {
        const shape = this.shape(this.tool, drag);
        scene.drawShape(outlineOf(shape), this.tool === 'person' ? 'pedestrian' : 'still', true);
        if (this.tool === 'person') scene.line([...shape.pose.slice(0, 2), ...shape.motion.goals[0]], theme.person, 1.5, [4, 4]);
      }
    } else if (drag?.kind === 'shape' && drag.moved) {
      const side = this.app.store.main;
      context.save();
      context.translate(drag.x2 - drag.x, drag.y2 - drag.y);
      context.globalAlpha = 0.6;
      scene.drawShape(scene.outline(side, drag.shape), 'still', true);
      context.restore();
    }
    if (this.cross) {
      const { x, y, yaw } = this.cross, r = 14 * px;
      scene.line([x - r, y, x + r, y], theme.accent, 2);
      scene.line([x, y - r, x, y + r], theme.accent, 2);
      if (POSES.includes(this.tool)) scene.arrow([x, y, yaw], theme.accent, '', { size: 18, hollow: true });
    }
  }
}

function toOdom(side, x, y) {
  const [ox, oy, yaw] = side.odom, dx = x - ox, dy = y - oy, cos = Math.cos(yaw), sin = Math.sin(yaw);
  return [cos * dx + sin * dy, cos * dy - sin * dx];
}

function outlineOf(shape) {
  const [x, y, yaw] = shape.pose;
  if (shape.radius) return { circle: [x, y, shape.radius] };
  const [a, b] = shape.box.map((v) => v / 2), cos = Math.cos(yaw), sin = Math.sin(yaw);
  return { points: [[-a, -b], [a, -b], [a, b], [-a, b]].flatMap(([u, v]) => [x + cos * u - sin * v, y + sin * u + cos * v]) };
}

function inside(points, x, y) {
  let result = false;
  for (let i = 0, j = points.length - 2; i < points.length; j = i, i += 2) {
    const [xi, yi, xj, yj] = [points[i], points[i + 1], points[j], points[j + 1]];
    if (yi > y !== yj > y && x < (xj - xi) * (y - yi) / (yj - yi) + xi) result = !result;
  }
  return result;
}
