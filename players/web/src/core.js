/** An error of the core: `code` is an `hfx_error` of players/core/hfx_player.h. */
export class HapticError extends Error {
  constructor(message, code) {
    super(message);
    this.name = "HapticError";
    this.code = code;
  }
}

const PAGE = 65536; // bytes of a page of WebAssembly memory
const TEXT_BYTES = 1008; // a text of a clip has at most 1,000 bytes

let compiled; // promise of the module, compiled once for all clips

/** The compiled core with the memory of one clip, its players and bodies. */
export class Core {
  static async make() {
    compiled ??= WebAssembly.compile(Uint8Array.from(atob(WASM), (letter) => letter.charCodeAt(0)));
    return new Core(await WebAssembly.instantiate(await compiled, { math: Math }));
  }

  #end;
  #text;
  #unused = new Map(); // size in bytes: addresses of blocks of that size
  #owners = new FinalizationRegistry(({ address, size }) => this.give(address, size));

  constructor(instance) {
    this.calls = instance.exports;
    this.calls._initialize?.();
    this.#end = this.calls.__heap_base.value;
    this.#text = this.take(TEXT_BYTES);
  }

  /**
   * Address of `size` zero bytes, aligned to 16. With an owner, the block is used again after the
   * owner was garbage collected.
   */
  take(size, owner) {
    const rounded = Math.ceil(size / 16) * 16;
    let address = this.#unused.get(rounded)?.pop();
    if (address === undefined) {
      address = Math.ceil(this.#end / 16) * 16;
      this.#end = address + rounded;
      const memory = this.calls.memory;
      const missing = this.#end - memory.buffer.byteLength;
      if (missing > 0) memory.grow(Math.ceil(missing / PAGE));
    }
    this.bytes(address, rounded).fill(0);
    if (owner) this.#owners.register(owner, { address, size: rounded });
    return address;
  }

  /** Marks a block as unused. */
  give(address, size) {
    const rounded = Math.ceil(size / 16) * 16;
    if (!this.#unused.has(rounded)) this.#unused.set(rounded, []);
    this.#unused.get(rounded).push(address);
  }

  /** Views are valid until the next `take`, which may replace the memory. */
  bytes(address, count) {
    return new Uint8Array(this.calls.memory.buffer, address, count);
  }

  floats(address, count) {
    return new Float32Array(this.calls.memory.buffer, address, count);
  }

  /** Address of a text that ends with a zero byte; a text too long for any clip is cut. */
  text(text) {
    const bytes = new TextEncoder().encode(text).subarray(0, TEXT_BYTES - 1);
    const room = this.bytes(this.#text, TEXT_BYTES);
    room.set(bytes);
    room[bytes.length] = 0;
    return this.#text;
  }

  /** One sentence about an error of the core. */
  sentence(code) {
    const bytes = new Uint8Array(this.calls.memory.buffer, this.calls.hfx_error_text(code));
    return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
  }

  check(code) {
    if (code) throw new HapticError(this.sentence(code), code);
  }
}
