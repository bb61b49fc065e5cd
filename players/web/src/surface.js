import { unknownName } from "./clip.js";

const HOLD_S = 0.05; // pointers may be slower than frames
const DEAD_MAN_MS = 100;
const FULL_M_S2 = 12.75; // 1.3 g, as of the map paper's phone

/** A haptic surface of a clip, which vibrates under a finger or a pointer that moves over it. */
export class HapticSurface {
  #index;
  #stroke;
  #out;
  #places = []; // u, v and speed of each since the last frame
  #waitedS = 0;
  #pointer = null; // id of the one that touches

  /** `name`: "" is the first; `fullMS2`: amplitude at full strength of outputs. */
  constructor(clip, name = "", { fullMS2 = FULL_M_S2, side = "any" } = {}) {
    const { core, surfaces } = clip;
    const names = surfaces.map((item) => item.name);
    this.#index = name ? names.indexOf(name) : 0;
    if (!names[this.#index]) throw unknownName("surface", name, names);
    this.clip = clip;
    this.surface = surfaces[this.#index];
    this.gain = 1;
    this.values = new Float32Array(2);
    this.vibrations = [{ side, column: 0, highest: fullMS2, deadManMs: DEAD_MAN_MS }];
    this.#stroke = core.take(core.calls.hfx_stroke_size(), this);
    this.#out = core.take(8, this);
  }

  /**
   * Something touches the surface at shares of its width and height, from the lower left corner; beyond 0 to 1,
   * too. Speed relative to the material in mm/s; below 0: that of the path.
   */
  touch(u, v, speedMmS = -1) {
    this.#places.push(u, v, speedMmS);
  }

  /** Ends the touch, in silence. */
  release() {
    this.#places.length = 0;
    this.#pointer = null;
    this.values[0] = 0;
    this.clip.core.calls.hfx_surface_lift(this.#stroke);
  }

  /**
   * Follows a pressed pointer on an element, whose area shows the map `repeat` times. Returns a
   * function that ends it.
   */
  follow(element, { repeat = [1, 1] } = {}) {
    const place = (event) => {
      const { left, top, width, height } = element.getBoundingClientRect();
      const u = (event.clientX - left) / width;
      const v = 1 - (event.clientY - top) / height;
      if (u < 0 || u > 1 || v < 0 || v > 1) this.release();
      else this.touch(repeat[0] * u, repeat[1] * v);
    };
    const begin = (event) => {
      if (this.#pointer !== null || event.button > 0) return;
      this.#pointer = event.pointerId;
      place(event);
    };
    const listeners = {
      // Without the capture of fingers, one that leaves the element reaches its neighbours.
      pointerdown: (event) => {
        if (element.hasPointerCapture?.(event.pointerId)) element.releasePointerCapture(event.pointerId);
        begin(event);
      },
      pointerenter: (event) => event.buttons & 1 && begin(event),
      pointermove: (event) => {
        if (event.pointerId !== this.#pointer) return;
        const events = event.getCoalescedEvents?.() ?? [];
        for (const item of events.length ? events : [event]) if (this.#pointer !== null) place(item);
      },
    };
    for (const name of ["pointerup", "pointercancel", "pointerleave"])
      listeners[name] = (event) => event.pointerId === this.#pointer && this.release();
    for (const [name, listener] of Object.entries(listeners)) element.addEventListener(name, listener);
    element.style?.setProperty("touch-action", "none"); // a finger strokes, and does not scroll
    return () => {
      for (const [name, listener] of Object.entries(listeners)) element.removeEventListener(name, listener);
      this.release();
    };
  }

  /** Plays the strongest place since the last frame: peak amplitude in m/s², and frequency in Hz. */
  advance(seconds) {
    const count = this.#places.length / 3;
    this.#waitedS += seconds;
    if (count > 0) {
      let strongest = -1;
      for (let k = 0; k < count; k++) {
        const [u, v, speed] = this.#places.slice(3 * k, 3 * k + 3);
        const [amplitude, hertz] = this.#feel(u, v, speed, this.#waitedS / count);
        if (!(amplitude > strongest)) continue;
        strongest = amplitude;
        this.values[0] = amplitude * this.gain;
        this.values[1] = hertz;
      }
      this.#places.length = 0;
      this.#waitedS = 0;
    } else if (this.#waitedS > HOLD_S) {
      this.values[0] = 0;
    }
    return this.values;
  }

  silence() {
    this.release();
    return this.values;
  }

  #feel(u, v, speed, seconds) {
    const { core, address } = this.clip;
    core.calls.hfx_surface_feel(address, this.#index, this.#stroke, u, v, speed, seconds, this.#out);
    return core.floats(this.#out, 2);
  }
}
