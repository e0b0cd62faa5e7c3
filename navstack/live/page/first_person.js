// What the camera of the robot sees, in a corner of the map. The server sends pictures only while it is shown.
import { $ } from './dom.js';

export class FirstPerson {
  constructor(app) {
    this.app = app;
    this.canvas = $('view').querySelector('canvas');
    this.context = this.canvas.getContext('2d');
    this.shown = null; // the picture on the canvas
    $('eye').addEventListener('click', () => this.toggle());
    $('view').addEventListener('click', () => $('view').classList.toggle('large'));
  }

  toggle() { if (this.app.store.world?.camera) this.app.layers.toggle('camera', !this.app.layers.get('camera').on); }

  update(side) {
    const { on, opacity } = this.app.layers.get('camera');
    if (!on && side) side.camera = null; // it would be old when it is shown again
    const picture = side?.camera, visible = !!picture && !!this.app.store.world?.camera;
    $('eye').setAttribute('aria-pressed', String(on));
    $('view').hidden = !visible;
    document.body.classList.toggle('viewing', visible);
    $('view').style.opacity = opacity;
    $('view').classList.toggle('second', side?.index === 1);
    if (!visible || picture === this.shown) return;
    this.shown = picture;
    const { width, height, rgb } = picture;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const image = this.context.createImageData(width, height), rgba = image.data;
    for (let from = 0, to = 0; from < rgb.length; from += 3, to += 4) { rgba[to] = rgb[from]; rgba[to + 1] = rgb[from + 1]; rgba[to + 2] = rgb[from + 2]; rgba[to + 3] = 255; }
    this.context.putImageData(image, 0, 0);
  }
}
