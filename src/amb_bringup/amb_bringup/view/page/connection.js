// The websocket to the server: it comes back by itself, and measures the time that messages take.

const SHORTEST_WAIT = 300, LONGEST_WAIT = 3000; // ms between attempts
const PING_PERIOD = 1000; // ms

export class Connection {
  // onMessage gets objects and binary frames (DataView); onChange gets whether the server is reached.
  constructor(onMessage, onChange) {
    this.roundTrip = 0; // ms
    this.onMessage = onMessage;
    this.onChange = onChange;
    this.wait = SHORTEST_WAIT;
    this.connect();
    setInterval(() => this.send({ do: "ping", at: performance.now() }), PING_PERIOD);
  }

  connect() {
    const protocol = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${protocol}://${location.host}/live`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.wait = SHORTEST_WAIT;
      this.onChange(true);
    };
    this.socket.onmessage = (event) => this.take(event.data);
    this.socket.onclose = (event) => {
      this.onChange(false, event.reason);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
  }

  take(data) {
    if (data instanceof ArrayBuffer) {
      this.onMessage(new DataView(data));
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "pong") this.roundTrip = performance.now() - message.at;
    else this.onMessage(message);
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}
