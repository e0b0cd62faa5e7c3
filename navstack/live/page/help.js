// The dialog with the keys.
import { el } from './dom.js';

const KEYS = [
  ['Space', 'pause or continue'], ['N', 'one control cycle'], ['Page Up', 'back 5 s'], ['Home', 'start again'],
  ['G', 'goal'], ['R', 'put the robot here'], ['V', 'ask and select'], ['Y', 'can the robot pass?'],
  ['D', 'disc'], ['B', 'box'], ['A', 'wall'], ['P', 'person'], ['Delete', 'remove'], ['E', 'erase walls in the saved map'], ['M', 'measure'], ['C', 'copy x,y,yaw'], ['T', 'drive by hand'], ['S', 'save'],
  ['F', 'follow the robot'], ['I', 'what the robot sees'], ['X', 'two robots: side by side, overlaid, one above the other'], ['0', 'whole map'], ['+ -', 'zoom'], ['Arrows', 'move the cross (Shift: faster); drive, after T'], ['[ ]', 'turn the heading at the cross'], ['Enter', 'use the tool at the cross'], ['Esc', 'ask and select; clears marks'],
];

export function helpText(dialog) {
  if (dialog.children.length) return;
  dialog.append(
    el('h1', {}, 'Keys'),
    el('div', { className: 'keys' }, ...KEYS.flatMap(([key, text]) => [el('kbd', {}, key), el('span', {}, text)])),
    el('p', {}, 'Driving by hand (T): the pad on the map, arrow keys, WASD, a game pad, or the keys of teleop_twist_keyboard: u i o / j k l / m , . with q z x e c for the speeds (Shift: sideways on a holonomic robot). The robot stops when everything is released.'),
    el('p', {}, 'Everything you do is recorded with its time. S saves the session as a scenario that navstack simulate reproduces byte for byte.'),
    el('form', { method: 'dialog' }, el('button', { className: 'primary' }, 'Close')));
}
