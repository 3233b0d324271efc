// The socket to the server: frames out, what is said of them in. It opens again by itself when the server was away.

const HEADER = 12; // bytes: number (4), time (8); then a JPEG
const PAIR = 12; // bytes, of two cameras: time of the right one (8), bytes of the left one's JPEG (4); then both
const REPLACED = 4001; // another page took over
const FIRST_WAIT = 300, LONGEST_WAIT = 2000; // ms
export const AHEAD = 2; // frames that may be on their way

export class Link {
  constructor(heard) {
    this.heard = heard; // {state, look, preview, trouble, up, down}
    this.sent = new Map(); // number → ms when the frame was taken
    this.number = 0;
    this.cameras = 1;
    this.wait = FIRST_WAIT;
    this.open();
  }

  get up() { return this.socket.readyState === WebSocket.OPEN; }

  get free() { return this.up && this.sent.size < AHEAD; }

  open() {
    const place = new URL("socket", location.href);
    place.protocol = place.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(place);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.wait = FIRST_WAIT; this.heard.up(); };
    this.socket.onmessage = ({ data }) => typeof data === "string" ? this.text(JSON.parse(data)) : this.picture(data);
    this.socket.onclose = ({ code }) => {
      this.sent.clear();
      this.heard.down(code === REPLACED);
      if (code === REPLACED) return;
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(this.wait * 1.6, LONGEST_WAIT);
    };
  }

  text(message) {
    if (message.type === "look") {
      const taken = this.sent.get(message.n);
      this.sent.delete(message.n);
      this.heard.look(message, taken);
    } else if (message.type === "state") {
      this.cameras = message.cameras;
      this.heard.state(message);
    } else {
      this.heard.trouble(message.text);
    }
  }

  picture(data) {
    const head = new DataView(data), number = head.getUint32(0, true);
    const cuts = this.cameras === 2 ? [8, 8 + head.getUint32(4, true), data.byteLength] : [4, data.byteLength];
    const parts = cuts.slice(1).map((end, k) => new Blob([data.slice(cuts[k], end)], { type: "image/jpeg" }));
    this.heard.preview(parts, number);
  }

  wish(wish, more = {}) {
    if (this.up) this.socket.send(JSON.stringify({ wish, ...more }));
  }

  // A place for a frame taken now: its number, or 0 if there is none.
  reserve(time) {
    if (!this.free) return 0;
    this.number = this.number % 4e9 + 1;
    this.sent.set(this.number, time);
    return this.number;
  }

  // The JPEGs of a frame, taken at `times`, ms.
  frame(number, times, jpegs) {
    if (!this.up || !this.sent.has(number)) return;
    let at = HEADER + (jpegs.length === 2 ? PAIR : 0);
    const message = new Uint8Array(at + jpegs.reduce((sum, jpeg) => sum + jpeg.byteLength, 0)), head = new DataView(message.buffer);
    head.setUint32(0, number, true);
    head.setFloat64(4, times[0], true);
    if (jpegs.length === 2) {
      head.setFloat64(HEADER, times[1], true);
      head.setUint32(HEADER + 8, jpegs[0].byteLength, true);
    }
    for (const jpeg of jpegs) {
      message.set(new Uint8Array(jpeg), at);
      at += jpeg.byteLength;
    }
    this.socket.send(message);
  }

  giveUp(number) { this.sent.delete(number); }
}
