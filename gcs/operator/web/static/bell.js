// A pilot looks at the vehicle, not at the screen: what goes wrong is heard too.

let sound = null;

/** Browsers make no sound before a first touch. */
export function wake() {
  sound ??= "AudioContext" in window ? new AudioContext() : null;
  sound?.resume();
}

/** beeps: how many; hz: how high. */
export function ring(beeps, hz) {
  navigator.vibrate?.(Array(beeps).fill([120, 80]).flat());
  if (sound?.state !== "running") return;
  for (let n = 0; n < beeps; n++) {
    const at = sound.currentTime + n * 0.2;
    const tone = new OscillatorNode(sound, { frequency: hz, type: "square" });
    tone.connect(new GainNode(sound, { gain: 0.08 })).connect(sound.destination);
    tone.start(at);
    tone.stop(at + 0.12);
  }
}
