// Second part of the program: code that is not needed for the first frame, drawing and solving. Its functions are in the
// function table of the first part. Until they are loaded, placeholders load them when called.
"use strict";

globalThis.calibRest = {
  /** Address of the second part. */
  address: null,
  /** Exports of the first part. */
  first: null,
  here: false,

  /** Joins the second part to the first. */
  async join(module) {
    await WebAssembly.instantiate(module, { first: this.first });
    this.here = true;
  },

  /** Loads and joins it synchronously, for a call before it was loaded. */
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

/** Imports of the first part: placeholders by table slot, for functions of the second part. */
calibRest.placeholders = new Proxy({}, { get: (_, slot) => (...values) => {
  try {
    if (!calibRest.here) calibRest.joinNow();
  } catch (error) {
    globalThis.calib?.panicked?.(`Part of the program could not be downloaded. ${error}`);
    throw error;
  }
  return calibRest.first.table.get(Number(slot))(...values);
} });
