// The rest of the program: what its first picture, drawing and solving do without. Its functions stand in the table of the
// first part; until they are there, what is called in their place fetches them.
"use strict";

globalThis.calibRest = {
  /** Where the rest is fetched. */
  address: null,
  /** What the first part exports, from its beginning on. */
  first: null,
  here: false,

  /** Joins the rest to the first part. */
  async join(module) {
    await WebAssembly.instantiate(module, { first: this.first });
    this.here = true;
  },

  /** Fetches and joins it at once, for who called something of it before it came. */
  joinNow() {
    const request = new XMLHttpRequest();
    request.open("GET", this.address, false);
    request.overrideMimeType("text/plain; charset=x-user-defined");
    request.send();
    if (request.status !== 200) throw new Error(`${this.address}: ${request.status}`);
    const bytes = Uint8Array.from(request.responseText, (c) => c.charCodeAt(0) & 0xff);
    new WebAssembly.Instance(new WebAssembly.Module(bytes), { first: this.first });
    this.here = true;
  },
};

/** What the first part imports: by the slot of the table that a function of the rest will stand in. */
calibRest.placeholders = new Proxy({}, { get: (_, slot) => (...values) => {
  try {
    if (!calibRest.here) calibRest.joinNow();
  } catch (error) {
    globalThis.calib?.panicked?.(`The rest of the program did not arrive. ${error}`);
    throw error;
  }
  return calibRest.first.table.get(Number(slot))(...values);
} });
