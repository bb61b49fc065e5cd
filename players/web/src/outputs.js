const SILENCE_MS = 10; // length of a pulse without strength, which ends a running one
const CYCLE_MS = 20; // of vibration patterns of phones
const MOST_CYCLES = 49; // browsers take patterns of 99 numbers

/** Base of outputs: the strongest vibration of sources (players, bodies, surfaces) on a side. */
class HapticOutput {
  #sources;
  #actuators; // for each source

  constructor(sources, { device = "" } = {}) {
    this.#sources = Array.isArray(sources) ? sources : [sources];
    this.#actuators = this.#sources.map(({ clip, vibrations }) => vibrations ?? vibrationsOf(clip, device));
    this.pulse = { share: 0, milliseconds: 0 };
  }

  /** Sets `pulse` to the strongest vibration of sides: its share of the highest, and the dead-man time. */
  strongest(...sides) {
    this.pulse.share = 0;
    this.pulse.milliseconds = 0;
    this.#sources.forEach((source, k) => {
      for (const actuator of this.#actuators[k]) {
        const share = source.values[actuator.column] / actuator.highest;
        if (!(share > this.pulse.share) || !sides.includes(actuator.side)) continue;
        this.pulse.share = Math.min(share, 1);
        this.pulse.milliseconds = actuator.deadManMs;
      }
    });
    return this.pulse;
  }
}

/** Tells whether a device is one of a name: "" is any, "glove" is glove, glove_left, glove_right. */
export function isDevice(id, name) {
  return !name || [name, `${name}_left`, `${name}_right`].includes(id);
}

/** Vibration actuators of the devices of a name. */
function vibrationsOf(clip, device) {
  return clip.devices
    .filter(({ id }) => isDevice(id, device))
    .flatMap((item) =>
      clip.actuators.slice(item.firstActuator, item.firstActuator + item.actuators).map((actuator) => ({
        modality: actuator.modality,
        side: actuator.side,
        column: actuator.firstColumn,
        highest: clip.columns[actuator.firstColumn].highest,
        deadManMs: item.deadManMs,
      })),
    )
    .filter((actuator) => actuator.modality === "vibration" && actuator.highest > 0);
}

/**
 * Vibrations on gamepads. The left side plays on the strong motor, which sits in the left grip, the right
 * side on the weak one in the right grip; what is on no side plays on both.
 */
export class GamepadHaptics extends HapticOutput {
  #on = new Set();

  /** `index`: of one gamepad; null: all of them. */
  constructor(sources, options = {}) {
    super(sources, options);
    this.index = options.index ?? null;
  }

  send() {
    const left = this.strongest("left", "any");
    const strong = left.share;
    let milliseconds = left.milliseconds;
    const right = this.strongest("right", "any");
    const weak = right.share;
    milliseconds = Math.max(milliseconds, right.milliseconds);
    for (const gamepad of navigator.getGamepads()) {
      if (!gamepad || (this.index !== null && gamepad.index !== this.index)) continue;
      if (strong > 0 || weak > 0) {
        this.#on.add(gamepad.index);
        play(gamepad, milliseconds, strong, weak);
      } else if (this.#on.delete(gamepad.index)) {
        play(gamepad, SILENCE_MS, 0, 0);
      }
    }
  }
}

function play(gamepad, duration, strongMagnitude, weakMagnitude) {
  const actuator = gamepad.vibrationActuator;
  if (actuator?.playEffect) {
    const effect = { startDelay: 0, duration, strongMagnitude, weakMagnitude };
    actuator.playEffect("dual-rumble", effect)?.catch?.(() => {}); // unplugged
  } else {
    pulse(gamepad.hapticActuators?.[0], Math.max(strongMagnitude, weakMagnitude), duration);
  }
}

function pulse(actuator, share, milliseconds) {
  actuator?.pulse?.(share, milliseconds)?.catch?.(() => {}); // unplugged, or the session ended
}

/** Vibrations on the controllers of a WebXR session, left and right. */
export class XRHaptics extends HapticOutput {
  #on = new Set();

  constructor(session, sources, options = {}) {
    super(sources, options);
    this.session = session;
  }

  send() {
    for (const { handedness, gamepad } of this.session.inputSources) {
      const actuator = gamepad?.hapticActuators?.[0];
      if (!actuator || (handedness !== "left" && handedness !== "right")) continue;
      const { share, milliseconds } = this.strongest(handedness);
      if (share > 0) {
        this.#on.add(handedness);
        pulse(actuator, share, milliseconds);
      } else if (this.#on.delete(handedness)) {
        pulse(actuator, 0, SILENCE_MS);
      }
    }
  }
}

/**
 * Vibrations on a phone, by `navigator.vibrate`, which knows on and off only: a strength is the share of each
 * 20 ms that the motor is on. A pattern is given when that share changes, and else at half its length, since
 * each begins the motor's cycle again.
 */
export class PhoneHaptics extends HapticOutput {
  #onMs = 0;
  #againMs = 0; // time at which the same pattern is given again
  #isRefused = false;

  /** The browser refused the last pattern, say because nobody has touched the page yet. */
  get isRefused() {
    return this.#isRefused;
  }

  send(nowMs = performance.now()) {
    const { share, milliseconds } = this.strongest("left", "right", "any");
    const onMs = share > 0 ? Math.max(Math.round(CYCLE_MS * share), 1) : 0;
    if (onMs === this.#onMs && (onMs === 0 || nowMs < this.#againMs)) return;
    this.#onMs = onMs;
    const cycles = Math.min(Math.max(Math.floor(milliseconds / CYCLE_MS), 1), MOST_CYCLES);
    this.#againMs = nowMs + (cycles * CYCLE_MS) / 2;
    const offMs = CYCLE_MS - onMs;
    let pattern = 0;
    if (onMs > 0) pattern = offMs === 0 ? [cycles * CYCLE_MS] : Array(cycles).fill([onMs, offMs]).flat().slice(0, -1);
    this.#isRefused = navigator.vibrate?.(pattern) === false;
  }
}
