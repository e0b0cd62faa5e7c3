// The socket: requests with answers, frames decoded in order, reconnection.
export const PROTOCOL = 2;
const RETRY_MS = [300, 600, 1200, 2500, 5000];

export class Connection {
  /** `handlers`: frame(header, blobs), status(name, text), notice(message), progress(message). */
  constructor(handlers) {
    this.handlers = handlers;
    this.pending = new Map();
    this.nextId = 1;
    this.attempt = 0;
    this.decoded = Promise.resolve();
    this.types = null;
    this.received = 0;
  }

  async start() {
    try {
      const schema = await (await fetch('schema.json')).json();
      this.types = new Set(Object.keys(schema.request.discriminator.mapping));
      if (schema.protocol !== PROTOCOL) {
        this.handlers.status('bad', `this page speaks version ${PROTOCOL} of the protocol, the server version ${schema.protocol}; reload the page`);
        return;
      }
    } catch {
      this.retry();
      return;
    }
    const address = new URL('socket', location.href);
    address.protocol = address.protocol.replace('http', 'ws');
    address.search = location.search;
    const socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    socket.onopen = () => {
      this.request({ type: 'hello', protocol: PROTOCOL }).then(() => {
        this.handlers.status('good', 'connected');
        this.handlers.connected();
      }, (error) => { this.stopped = true; this.handlers.status('bad', error.message); });
    };
    socket.onmessage = (event) => this.receive(event.data, socket);
    socket.onclose = (event) => {
      for (const waiting of this.pending.values()) waiting.reject(new Error('the connection was lost'));
      this.pending.clear();
      if (event.code === 1008) this.handlers.status('bad', 'the server closed the connection; reload the page');
      else if (!this.stopped) this.retry();
    };
  }

  retry() {
    const wait = RETRY_MS[Math.min(this.attempt++, RETRY_MS.length - 1)];
    this.handlers.status('warn', 'connection lost, trying again');
    setTimeout(() => this.start(), wait);
  }

  receive(data, socket) {
    if (typeof data === 'string') {
      const message = JSON.parse(data);
      if (message.type === 'notice' || message.type === 'progress') { this.handlers[message.type](message); return; }
      const waiting = this.pending.get(message.id);
      if (!waiting) { if (!message.ok) this.handlers.notice({ text: message.text, severity: 'error' }); return; }
      this.pending.delete(message.id);
      if (message.ok) waiting.resolve(message);
      else waiting.reject(Object.assign(new Error(message.text), { code: message.code }));
      return;
    }
    this.received += data.byteLength;
    const payload = inflate(data); // begins at once; frames are applied in order
    payload.catch(() => {}); // reported below, after the frames before it
    this.decoded = this.decoded.then(async () => {
      const { header, blobs } = split(await payload);
      this.handlers.frame(header, blobs);
      if (header.type === 'frame') { this.send({ type: 'ack', frame: header.frame }); this.attempt = 0; }
    }).catch((error) => { // frames are differences: after a lost one, everything has to be sent again
      console.error(error);
      socket.close();
    });
  }

  get open() { return this.socket?.readyState === WebSocket.OPEN; }

  send(message) {
    if (this.types && !this.types.has(message.type)) throw new Error(`the schema has no request ${message.type}`);
    if (this.open) this.socket.send(JSON.stringify(message));
  }

  /** Resolves with the answer, rejects with its reason. */
  request(message) {
    if (!this.open) return Promise.reject(new Error('not connected; the page tries to connect again'));
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.pending.set(id, { resolve, reject });
      this.send({ ...message, id });
    });
  }
}

async function inflate(buffer) {
  const bytes = new Uint8Array(buffer);
  if (bytes[0] === 0) return bytes.slice(1).buffer;
  const stream = new Blob([bytes.subarray(1)]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Response(stream).arrayBuffer();
}

function split(payload) {
  const length = new DataView(payload).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(payload, 4, length)));
  const blobs = [];
  let at = 4 + length;
  for (const size of header.blobs) { blobs.push(payload.slice(at, at + size)); at += size; }
  return { header, blobs };
}
