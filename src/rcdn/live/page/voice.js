// What is heard: a tone when a picture is taken, and words for a screen reader, not more often than they can be read out.

const STEADY = 900, APART = 3500; // ms
const line = document.getElementById("announce");
let context = null, waiting = "", said = "", last = 0, timer = 0;

// Browsers allow sound after a click only.
export function allowSound() {
  context ??= new (window.AudioContext ?? window.webkitAudioContext)();
  context.resume();
}

export function tone(...pitches) {
  if (!context || context.state !== "running" || !document.getElementById("sound").checked) return;
  pitches.forEach((pitch, k) => {
    const sound = context.createOscillator(), loud = context.createGain(), at = context.currentTime + 0.12 * k;
    sound.frequency.value = pitch;
    loud.gain.setValueAtTime(0.0001, at);
    loud.gain.exponentialRampToValueAtTime(0.25, at + 0.015);
    loud.gain.exponentialRampToValueAtTime(0.0001, at + 0.18);
    sound.connect(loud).connect(context.destination);
    sound.start(at);
    sound.stop(at + 0.2);
  });
}

// Say what holds for a while; `now`: at once.
export function announce(text, now = false) {
  if (now) {
    clearTimeout(timer);
    put(text);
  } else if (text !== waiting && text) {
    waiting = text;
    clearTimeout(timer);
    timer = setTimeout(() => put(text), Math.max(STEADY, last + APART - performance.now()));
  }
}

function put(text) {
  if (text !== said) line.textContent = said = text;
  waiting = text;
  last = performance.now();
}
