// Two parameter sets in the same world: the differences in time, length and clearance.
import { $, el, refresh } from './dom.js';

export function showVersus(store) {
  const box = $('versus');
  box.hidden = store.sides.length < 2;
  if (box.hidden || !store.sides.every((side) => side.pose)) return;
  const rows = store.sides.map((side) => {
    const done = side.goals.ended.filter((goal) => goal.state === 'SUCCEEDED'), clear = side.samples.map((s) => s[1]).filter((c) => c !== null);
    return { reached: done.length, time: side.goals.ended.reduce((sum, goal) => sum + goal.time, 0), length: side.length, clearance: clear.length ? Math.min(...clear) : null };
  });
  const difference = (key, digits) => (rows[0][key] === null || rows[1][key] === null ? '–' : `${rows[1][key] >= rows[0][key] ? '+' : ''}${(rows[1][key] - rows[0][key]).toFixed(digits)}`);
  const cells = (name, row, extra) => el('tr', { className: extra }, el('td', {}, el('i', {}, '■ '), name), el('td', {}, String(row.reached)), el('td', {}, `${row.time.toFixed(1)} s`), el('td', {}, `${row.length.toFixed(2)} m`), el('td', {}, row.clearance === null ? '–' : `${row.clearance.toFixed(2)} m`));
  refresh(box, JSON.stringify(rows), () => [el('table', {},
    el('tr', {}, el('th', {}, ''), el('th', {}, 'goals'), el('th', {}, 'time'), el('th', {}, 'length'), el('th', {}, 'min. clearance')),
    ...rows.map((row, i) => cells(store.world.labels[i], row, i ? 'second' : 'first')),
    el('tr', {}, el('td', {}, 'difference'), el('td', {}, difference('reached', 0)), el('td', {}, `${difference('time', 1)} s`), el('td', {}, `${difference('length', 2)} m`), el('td', {}, `${difference('clearance', 2)} m`)))]);
}
