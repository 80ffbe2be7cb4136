// The line to the console: what is said on it, and a new one when it breaks off.

/** Read a packed message: its header, and its arrays without copying. */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const kinds = { i4: Int32Array, f4: Float32Array, u1: Uint8Array, i2: Int16Array };
  let at = 4 + length;
  const arrays = header.arrays.map(([kind, size]) => {
    const array = new kinds[kind](buffer, at, size);
    at += Math.ceil(array.byteLength / 4) * 4;
    return array;
  });
  return { header, arrays };
}

export class Link {
  /** Listeners: topic(name, word), picture(header, arrays), role(role), refused(why), open(), lost(). */
  constructor(listeners) {
    this.on = listeners;
    this.pause = 500;
    this.connect();
  }

  connect() {
    const address = new URL("talk", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.pause = 500; this.on.open(); };
    this.socket.onmessage = (event) => this.hear(event.data);
    this.socket.onclose = () => {
      this.on.lost();
      setTimeout(() => this.connect(), this.pause);
      this.pause = Math.min(2 * this.pause, 8000);
    };
  }

  hear(data) {
    if (typeof data !== "string") {
      const { header, arrays } = unpack(data);
      this.on.picture(header, arrays);
      return;
    }
    const told = JSON.parse(data);
    if (told.role) this.on.role(told.role);
    else if (told.refused) this.on.refused(told.refused);
    else this.on.topic(told.topic, told.word);
  }

  wish(what, more = {}) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ do: what, ...more }));
  }
}
