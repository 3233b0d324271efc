// The browser's camera: every frame that there is room for becomes a JPEG and goes to the server.

const policy = self.trustedTypes?.createPolicy("rcdn", { createScriptURL: () => "encode.js" });
const ENCODER = policy?.createScriptURL("") ?? "encode.js";

export class Camera {
  constructor(video, link) {
    this.video = video;
    this.link = link;
    this.encoder = new Worker(ENCODER);
    this.encoder.onmessage = ({ data }) => link.frame(data.number, data.time, data.jpeg);
    this.stream = null;
  }

  async start(device, [width, height]) {
    this.stop();
    if (!navigator.mediaDevices) throw new Error("This browser gives a page no camera here: open it at 127.0.0.1, or by https.");
    const wanted = { width: { ideal: width }, height: { ideal: height }, frameRate: { ideal: 30 } };
    if (device) wanted.deviceId = { exact: device };
    this.stream = await navigator.mediaDevices.getUserMedia({ video: wanted, audio: false });
    this.video.srcObject = this.stream;
    await this.video.play();
    this.next();
  }

  stop() {
    this.stream?.getTracks().forEach((track) => track.stop());
    this.stream = null;
  }

  // Whether the camera looks away from who holds it, as the one on a phone's back does.
  get faces() { return this.stream?.getVideoTracks()[0]?.getSettings().facingMode ?? ""; }

  next() {
    if (!this.stream) return;
    const again = () => { this.grab(); this.next(); };
    if (this.video.requestVideoFrameCallback) this.video.requestVideoFrameCallback(again);
    else requestAnimationFrame(again);
  }

  async grab() {
    if (!this.video.videoWidth) return;
    const time = performance.now(), number = this.link.reserve(time);
    if (!number) return;
    try {
      const picture = self.VideoFrame ? new VideoFrame(this.video) : await createImageBitmap(this.video);
      this.encoder.postMessage({ picture, number, time }, [picture]);
    } catch {
      this.link.giveUp(number); // the camera has no picture just now
    }
  }

  // The cameras that there are, as [identity, name]; names only once one was allowed.
  static async all() {
    const devices = await navigator.mediaDevices?.enumerateDevices?.() ?? [];
    return devices.filter((d) => d.kind === "videoinput" && d.deviceId).map((d, k) => [d.deviceId, d.label || `Camera ${k + 1}`]);
  }
}

// What a person can do about a camera that doesn't open.
export function cameraWords(error) {
  const words = {
    NotAllowedError: "The browser doesn't allow the camera. Allow it beside the address, then start again.",
    NotFoundError: "There is no camera. Connect one, then start again.",
    NotReadableError: "Another program uses the camera. End it, then start again.",
    OverconstrainedError: "The camera that was chosen is gone. Choose another one.",
  };
  return words[error.name] ?? error.message;
}
