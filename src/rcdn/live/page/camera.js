// The browser's cameras: every frame (of two cameras: every pair) that there is room for becomes JPEGs and goes to the server.

const policy = self.trustedTypes?.createPolicy("rcdn", { createScriptURL: () => "encode.js" });
const ENCODER = policy?.createScriptURL("") ?? "encode.js";
const APART = 40; // ms: pictures that arrive farther apart aren't of one moment; the server refuses them, too
const HALVES = "halves"; // instead of a second camera: one whose pictures hold both, side by side

export class Camera {
  constructor(videos, link) {
    this.videos = videos;
    this.link = link;
    this.encoder = new Worker(ENCODER);
    this.encoder.onmessage = ({ data }) => link.frame(data.number, data.times, data.jpegs);
    this.streams = [];
  }

  // `devices`: one, or two; "" is any camera.
  async start(devices, [width, height]) {
    this.stop();
    if (!navigator.mediaDevices) throw new Error("This browser gives a page no camera here: open it at 127.0.0.1, or by https.");
    this.halves = devices[1] === HALVES;
    const streams = [await opened(devices[0], this.halves ? 2 * width : width, height)];
    try {
      if (devices.length === 2 && !this.halves) streams.push(await opened(devices[1] || await another(streams[0]), width, height));
    } catch (error) {
      stopped(streams);
      throw error;
    }
    this.streams = streams;
    const shown = this.videos.slice(0, devices.length);
    this.arrived = streams.map(() => null); // ms when the newest frame came that wasn't sent yet
    await Promise.all(shown.map(async (video, k) => {
      video.classList.toggle("half", this.halves);
      video.classList.toggle("second", k === 1);
      video.srcObject = streams[k] ?? streams[0];
      await video.play();
    }));
    streams.forEach((_, k) => this.next(k, streams));
  }

  stop() {
    stopped(this.streams);
    this.streams = [];
  }

  // Whether the camera looks away from who holds it, as the one on a phone's back does.
  get faces() { return this.streams[0]?.getVideoTracks()[0]?.getSettings().facingMode ?? ""; }

  // [width, height] of each camera's pictures.
  get sizes() {
    const part = this.halves ? 2 : 1;
    return this.videos.map((video) => [Math.floor(video.videoWidth / part), video.videoHeight]);
  }

  next(k, streams) {
    if (this.streams !== streams) return;
    const again = (_, facts) => {
      this.arrived[k] = facts?.captureTime ?? performance.now();
      this.grab();
      this.next(k, streams);
    };
    if (this.videos[k].requestVideoFrameCallback) this.videos[k].requestVideoFrameCallback(again);
    else requestAnimationFrame(again);
  }

  async grab() {
    const videos = this.videos.slice(0, this.streams.length), times = [...this.arrived];
    if (!videos.length || times.includes(null) || videos.some((video) => !video.videoWidth)) return;
    if (Math.max(...times) - Math.min(...times) > APART) return;
    const number = this.link.reserve(performance.now());
    if (!number) return;
    this.arrived.fill(null);
    try {
      const pictures = await Promise.all(videos.map((video) => self.VideoFrame ? new VideoFrame(video) : createImageBitmap(video)));
      if (this.halves) times.push(times[0]);
      this.encoder.postMessage({ pictures, halves: this.halves, number, times }, pictures);
    } catch {
      this.link.giveUp(number); // a camera has no picture just now
    }
  }

  // The cameras that there are, as [identity, name]; names only once one was allowed.
  static async all() {
    const devices = await navigator.mediaDevices?.enumerateDevices?.() ?? [];
    return devices.filter((d) => d.kind === "videoinput" && d.deviceId).map((d, k) => [d.deviceId, d.label || `Camera ${k + 1}`]);
  }
}

function opened(device, width, height) {
  const wanted = { width: { ideal: width }, height: { ideal: height }, frameRate: { ideal: 30 } };
  if (device) wanted.deviceId = { exact: device };
  return navigator.mediaDevices.getUserMedia({ video: wanted, audio: false });
}

function stopped(streams) {
  streams.forEach((stream) => stream.getTracks().forEach((track) => track.stop()));
}

// A camera that isn't the one of `stream`.
async function another(stream) {
  const first = stream.getVideoTracks()[0].getSettings().deviceId;
  const other = (await Camera.all()).find(([identity]) => identity !== first);
  if (!other) throw new Error("There is one camera only. Connect the other one, or choose that its pictures hold both.");
  return other[0];
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
