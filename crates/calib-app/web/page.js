// Page around the app: loads it with progress, queues requests until it runs, and shows messages when it cannot:
// missing WebAssembly or WebGL, a panic, a lost graphics context, or failed storage.
"use strict";

(() => {
  const at = (id) => document.getElementById(id);
  const canvas = () => at("canvas");

  /** Shows a message instead of the app, with buttons. */
  const trouble = (title, text, ways = [], detail = "") => {
    at("trouble-title").textContent = title;
    at("trouble-text").textContent = text;
    at("trouble-ways").replaceChildren(...ways.map(([label, act]) => {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "button";
      button.textContent = label;
      button.onclick = act;
      return button;
    }));
    at("trouble-detail").textContent = detail;
    at("trouble-detail").parentElement.hidden = !detail;
    at("kept").replaceChildren();
    at("start").hidden = true;
    at("trouble").hidden = false;
    at("trouble").querySelector("button")?.focus();
  };

  /** Lists the sites stored in the browser, with a download button each. */
  const listKept = async () => {
    const records = await calib.store.list().catch(() => []);
    at("kept").replaceChildren(...records.map((record) => {
      const row = document.createElement("li");
      const name = document.createElement("span");
      name.textContent = `${record.name || "site"}: ${record.cameras} camera${record.cameras === 1 ? "" : "s"}, ${new Date(record.kept).toLocaleString()}`;
      const button = document.createElement("button");
      button.type = "button";
      button.className = "button";
      button.textContent = "Download";
      button.onclick = () => calib.store.rescueKept(record.id);
      row.append(name, button);
      return row;
    }));
  };

  const reload = ["Reload the page", () => location.reload()];
  const rescue = () => {
    const { record, images } = calib.store.boat;
    return record ? [["Download the site", () => calib.store.rescue(record, images)]] : [];
  };

  const cannot = (what) => {
    const text = `This browser ${what}. Calib needs a current Firefox, Chrome, Edge or Safari with WebAssembly and WebGL 2.`;
    trouble("Calib cannot run in this browser", `${text} You can download the stored sites and solve them with the command-line tool calib.`);
    listKept();
  };

  // Functions called by the app.
  calib.panicked = (message) => {
    if (calib.broken) return;
    calib.broken = true;
    // The last finished gesture is in the lifeboat, independent of the app's memory.
    setTimeout(() => {
      trouble("Calib stopped", "The program failed. Your site is saved up to the last finished step.",
        [...rescue(), reload], message);
      listKept();
    });
  };
  calib.contextLost = () => trouble("The graphics context was lost",
    "This happens when a laptop sleeps or a driver restarts. Your work is kept.",
    [["Restore the display", () => calib.restart()], ...rescue()]);
  calib.contextBack = () => { at("trouble").hidden = true; canvas().focus(); };
  calib.shown = () => {
    canvas().classList.add("shown");
    at("start").hidden = true;
    // Focus the canvas so that keys work at once. Hidden elements cannot have the focus.
    if (at("trouble").hidden) canvas().focus({ preventScroll: true });
    performance.mark("calib-shown");
    document.documentElement.dataset.shown = Math.round(performance.now());
  };
  /** Replaces the canvas by one with a working context. */
  calib.freshCanvas = () => {
    const fresh = canvas().cloneNode();
    canvas().replaceWith(fresh);
    return fresh;
  };
  /** Opens a file chooser; resolves with an empty list if it is cancelled. */
  calib.pick = async (accept, multiple) => {
    // The browser can delete an input outside the document while its file chooser is open.
    const input = Object.assign(document.createElement("input"), { type: "file", accept, multiple, hidden: true });
    document.body.append(input);
    const files = await new Promise((resolve) => {
      input.onchange = () => resolve([...input.files]);
      input.oncancel = () => resolve([]);
      input.click();
    });
    input.remove();
    return files.length && !await calib.reads() ? [] : files;
  };
  /** Converts an SVG to a PNG on white; `side` is the longer side in pixels. As an image, an SVG loads no files and runs no scripts. */
  calib.draw = async (bytes, side) => {
    const PER_UNIT = { px: 1, "": 1, pt: 96 / 72, pc: 16, in: 96, cm: 96 / 2.54, mm: 96 / 25.4 };
    const text = new TextDecoder().decode(bytes);
    const [tag] = /<svg\b(?:[^>"']|"[^"]*"|'[^']*')*>/.exec(text) ?? [];
    if (!tag) throw new Error("The plan is not a complete SVG drawing. Save it again, or as PNG.");
    const own = (name) => new RegExp(`\\s${name}\\s*=\\s*(?:"([^"]*)"|'([^']*)')`).exec(tag)?.slice(1).find((value) => value != null);
    const box = (own("viewBox") ?? "").trim().split(/[\s,]+/).map(Number);
    const length = (name) => {
      const [, number, unit] = /^\s*([\d.eE+-]+)\s*([a-z]*)\s*$/.exec(own(name) ?? "") ?? [];
      return number * PER_UNIT[unit];
    };
    const [w, h] = [length("width") || box[2], length("height") || box[3]];
    if (!(w > 0 && h > 0 && w < 1e9 && h < 1e9)) throw new Error("The drawing has no size. Add a viewBox, or save it as PNG.");
    const zoom = side / Math.max(w, h);
    const picture = document.createElement("canvas");
    [picture.width, picture.height] = [w, h].map((length) => Math.max(1, Math.round(length * zoom)));
    const rest = tag.slice(4).replace(/\s(?:width|height)\s*=\s*(?:"[^"]*"|'[^']*')/g, "");
    const sized = `<svg width="${picture.width}" height="${picture.height}"${box.length === 4 ? "" : ` viewBox="0 0 ${w} ${h}"`}${rest}`;
    return paint(text.replace(tag, () => sized), picture);
  };
  /** Draws a part of an SVG document, whose unit is one pixel, as a PNG of this size. */
  calib.drawPart = async (bytes, part, width, height) => {
    const text = new TextDecoder().decode(bytes);
    const [tag] = /<svg\b[^>]*>/.exec(text);
    const rest = tag.slice(4).replace(/\s(?:width|height|viewBox)\s*=\s*"[^"]*"/g, "");
    const sized = `<svg width="${width}" height="${height}" preserveAspectRatio="none" viewBox="${part.join(" ")}"${rest}`;
    return paint(text.replace(tag, () => sized), Object.assign(document.createElement("canvas"), { width, height }));
  };
  /** Paints an SVG text on a white canvas, and returns a PNG. */
  const paint = async (text, picture) => {
    const url = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
    try {
      const image = new Image();
      await new Promise((resolve, reject) => {
        image.onload = resolve;
        image.onerror = () => reject(new Error("The plan is not a complete SVG drawing. Save it again, or as PNG."));
        image.src = url;
      });
      const context = picture.getContext("2d");
      context.fillStyle = "#fff";
      context.fillRect(0, 0, picture.width, picture.height);
      context.drawImage(image, 0, 0, picture.width, picture.height);
      const png = await new Promise((resolve) => picture.toBlob(resolve, "image/png"));
      return new Uint8Array(await png.arrayBuffer());
    } finally { URL.revokeObjectURL(url); }
  };
  /** Converts an image in a format that only the browser reads to a PNG. */
  calib.convert = async (bytes) => {
    const image = await createImageBitmap(new Blob([bytes]));
    const picture = Object.assign(document.createElement("canvas"), { width: image.width, height: image.height });
    picture.getContext("2d").drawImage(image, 0, 0);
    image.close();
    const png = await new Promise((resolve) => picture.toBlob(resolve, "image/png"));
    return new Uint8Array(await png.arrayBuffer());
  };
  /** Open video: the element, its address, and the promise of its first frame. */
  let clip = null;
  /** Waits for an event of the open video. */
  const next = (video, name) => new Promise((resolve, reject) => {
    const fail = (text) => () => { clearTimeout(patience); reject(new Error(text)); };
    const patience = setTimeout(fail("was not read in time. Try again, or use a shorter video"), 20000);
    video.addEventListener(name, () => { clearTimeout(patience); resolve(); }, { once: true });
    video.addEventListener("error", fail("cannot be decoded by this browser. Use an MP4 file with H.264, or save one frame as PNG"), { once: true });
  });
  calib.closeVideo = () => {
    if (!clip) return;
    const { video, url } = clip;
    clip = null;
    // Ends the waits for this video.
    video.dispatchEvent(new Event("error"));
    video.removeAttribute("src");
    video.load();
    URL.revokeObjectURL(url);
  };
  calib.openVideo = (bytes) => {
    calib.closeVideo();
    const url = URL.createObjectURL(new Blob([bytes]));
    const video = Object.assign(document.createElement("video"), { muted: true, preload: "auto", playsInline: true });
    const loaded = next(video, "loadeddata");
    loaded.catch(() => {});
    video.src = url;
    // Some browsers decode nothing before the video is played.
    video.play().then(() => video.pause(), () => {});
    clip = { video, url, loaded, last: Promise.resolve() };
  };
  const readFrames = async ({ video, loaded }, time, count, side, each) => {
    /** Largest memory of all frames together, in bytes. */
    const MAX_BYTES = 4e8;
    await loaded;
    /** Shows a frame; resolves to the time at which it appears. */
    const seek = async (at) => {
      if (clip?.video !== video) throw new Error("is closed");
      const shown = new Promise((resolve) => {
        setTimeout(() => resolve(at), 300);
        video.requestVideoFrameCallback?.((_, frame) => resolve(frame.mediaTime));
      });
      const sought = next(video, "seeked");
      // Rounding down would show the frame before.
      video.currentTime = at + 1e-4;
      await sought;
      return shown;
    };
    // Some recordings state their duration only at their end.
    if (!isFinite(video.duration)) await seek(1e7);
    const duration = isFinite(video.duration) ? video.duration : video.currentTime;
    const zoom = side ? Math.min(1, side / Math.max(video.videoWidth, video.videoHeight)) : 1;
    const [width, height] = [video.videoWidth, video.videoHeight].map((length) => Math.round(length * zoom));
    if (!(width > 0 && height > 0)) throw new Error("contains no images");
    const most = Math.max(1, Math.min(count, Math.floor(MAX_BYTES / (4 * width * height))));
    const times = time < 0 ? Array.from({ length: most }, (_, i) => (i + 0.5) / most * duration) : [time];
    const paint = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d", { willReadFrequently: true });
    for (const [index, at] of times.entries()) {
      const appears = await seek(at);
      paint.drawImage(video, 0, 0, width, height);
      const { data } = paint.getImageData(0, 0, width, height);
      if (!each((index + 1) / times.length, appears, width, height, new Uint8Array(data.buffer))) break;
    }
    return duration;
  };
  /** Reads frames of the open video: the frame at `time` seconds, or `count` frames evenly spread if `time` is negative; fewer if the memory is too small. The longer side is at most `side` pixels unless `side` is 0. `each` gets the share of the work done, time, width, height and RGBA pixels, and returns whether to continue. Resolves to the duration in seconds. Requests run one after the other, because each moves the video to other times. */
  calib.frames = async (...request) => {
    if (!clip) throw new Error("is closed");
    const own = clip;
    own.last = own.last.catch(() => {}).then(() => readFrames(own, ...request));
    return own.last;
  };
  /** Returns an image of the demonstration that is delivered with the page, or null. */
  calib.picture = async (name) => {
    const inline = document.querySelector(`script[data-picture="${CSS.escape(name)}"]`);
    if (inline) return Uint8Array.from(atob(inline.textContent), (c) => c.charCodeAt(0));
    const file = JSON.parse(document.documentElement.dataset.pictures || "{}")[name];
    const response = file && await fetch(file).catch(() => null);
    return response?.ok ? new Uint8Array(await response.arrayBuffer()) : null;
  };
  calib.wake = () => {};
  Object.defineProperty(calib, "still", { get: () => matchMedia("(prefers-reduced-motion: reduce)").matches });
  const want = (wish) => { calib.queue.push(wish); calib.wake(); };

  // Accessibility tree of the app, mirrored as HTML for screen readers.
  const ROLES = { Button: "button", CheckBox: "checkbox", RadioButton: "radio", Slider: "slider", TextInput: "textbox", MultilineTextInput: "textbox", SpinButton: "spinbutton", Link: "link", Image: "img", ComboBox: "combobox", MenuItem: "menuitem", Heading: "heading" };
  const nodes = new Map();
  calib.mirror = (text) => {
    const tree = JSON.parse(text);
    const order = [];
    for (const node of tree.nodes) {
      let element = nodes.get(node.id);
      if (!element) {
        element = document.createElement("div");
        element.dataset.id = node.id;
        element.onclick = () => { calib.queue.push({ click: node.id }); calib.wake(); };
        nodes.set(node.id, element);
      }
      const attributes = { role: ROLES[node.role] ?? null, "aria-label": node.label, "aria-checked": node.role === "Button" ? null : node.checked, "aria-pressed": node.role === "Button" ? node.checked : null, "aria-live": node.live, "aria-description": node.description,
        "aria-disabled": node.disabled ? "true" : null, "aria-valuetext": node.value, "data-at": node.at };
      for (const [name, value] of Object.entries(attributes)) {
        if (value == null) element.removeAttribute(name);
        else if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
      }
      const words = ROLES[node.role] ? "" : [node.label, node.value].filter(Boolean).join(" ");
      if (element.textContent !== words) element.textContent = words;
      order.push(element);
    }
    const alive = new Set(tree.nodes.map((node) => node.id));
    for (const [id, element] of nodes) if (!alive.has(id)) { element.remove(); nodes.delete(id); }
    order.forEach((element, i) => { if (at("mirror").children[i] !== element) at("mirror").insertBefore(element, at("mirror").children[i] ?? null); });
    if (tree.spoken && at("spoken").textContent !== tree.spoken) at("spoken").textContent = tree.spoken;
  };

  // Key combinations of the app that the browser would handle itself.
  addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && (/^[adeikosz]$/i.test(event.key) || (event.shiftKey && /^[cpv]$/i.test(event.key)) || (event.altKey && event.key === "n")) && at("trouble").hidden) event.preventDefault();
  });
  addEventListener("contextmenu", (event) => { if (event.target === canvas()) event.preventDefault(); });
  addEventListener("beforeunload", (event) => { if (calib.unkept && !calib.broken) event.preventDefault(); });
  // A file dropped before the app runs must not replace the page.
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    // The app handles the drop once it is shown and can read files.
    if (at("start").hidden && (!address() || calibRest.here)) return;
    event.stopImmediatePropagation();
    read([...event.dataTransfer.files]);
  }, { capture: true });
  const queued = (words, wish) => { at("state").textContent = words; want(wish); };
  for (const id of ["open", "add"]) at(id).onchange = () => read([...at(id).files]);
  at("demonstration").onclick = () => queued("Opening the demonstration…", { command: "demonstration" });
  at("tour").onclick = () => queued("Opening the tour…", { command: "tour" });

  const read = async (files) => {
    at("state").textContent = "Opening…";
    if (await calib.reads()) want({ files });
  };

  const progress = (share) => { at("progress").value = share; };

  /** Returns a response with the WebAssembly type, because some hosts send another type. */
  const program = (bytes) => new Response(bytes, { headers: { "Content-Type": "application/wasm" } });
  const body = async (url) => {
    const response = await fetch(url);
    if (!response.ok) throw new Error(`${url}: ${response.status}`);
    return response.body;
  };
  /** Returns the app's bytes as a response that updates the progress bar. */
  const counted = (bytes, size) => {
    let seen = 0;
    const counter = new TransformStream({ transform(chunk, out) { seen += chunk.byteLength; progress(seen / size); out.enqueue(chunk); } });
    return program(bytes.pipeThrough(counter));
  };
  const fetched = async () => {
    const { wasm, size } = document.documentElement.dataset;
    const inline = at("wasm");
    if (inline) {
      const bytes = Uint8Array.from(atob(inline.textContent), (c) => c.charCodeAt(0));
      inline.remove();
      return counted(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")), size);
    }
    return counted(await body(wasm), size);
  };

  /** Returns the address of the second part of the program, or nothing if the program is in one part. */
  const address = () => {
    const { rest } = document.documentElement.dataset;
    return rest && new URL(rest, location.href).href;
  };
  let begin, rest = null;
  const begun = new Promise((resolve) => { begin = resolve; });
  /** Loads the second part of the program and joins it to the first. A failed download is repeated at the next call. */
  calib.rest = () => rest ??= (async () => {
    if (!address()) return null;
    await begun;
    const module = await WebAssembly.compileStreaming(program(await body(address())));
    await calibRest.join(module);
    return module;
  })().catch((error) => {
    rest = null;
    throw new Error(`part of the program could not be downloaded: ${error}`);
  });
  /** Returns whether files can be read, and shows a message if not. */
  calib.reads = async () => {
    try {
      await calib.rest();
      return true;
    } catch (error) {
      trouble("Files cannot be read yet", "Part of the program could not be downloaded. Continue, and choose the files again when the network is back.",
        [["Continue", goOn], ...rescue()], String(error));
      return false;
    }
  };
  const goOn = () => {
    at("trouble").hidden = true;
    at("start").hidden = "shown" in document.documentElement.dataset;
    at("state").textContent = "";
    if (at("start").hidden) canvas().focus();
  };

  /** Runs long work in workers of the same program, one task after another per worker. Each slow kind of task has its
   * own worker, so that images need not wait and the task can be cancelled. */
  const OWN = ["refine", "propose", "place", "compare", "recover"];
  const workers = new Map();
  const hire = (lane) => {
    const asked = new Map();
    const glue = at("glue");
    const scripts = [at("rest"), glue].filter(Boolean);
    const source = glue.src ? `importScripts(${scripts.map((script) => JSON.stringify(script.src))});` : glue.textContent;
    const listen = `
      let ready, begun = false;
      const begin = async (module, rest) => {
        if (rest) calibRest.address = ${JSON.stringify(address())};
        await wasm_bindgen({ module_or_path: module });
        if (rest) await calibRest.join(rest);
        begun = true;
      };
      onmessage = async ({ data: { id, module, rest, kind, name, width, bytes } }) => {
        if (module) { ready = begin(module, rest); return; }
        try {
          await ready;
          const result = calibWork(kind, name, width, bytes);
          postMessage({ id, result }, result.filter((part) => part.buffer).map((part) => part.buffer));
        } catch (error) { postMessage({ id, error: String(error?.message ?? error), fatal: !begun || error instanceof WebAssembly.RuntimeError }); }
      };`;
    const url = URL.createObjectURL(new Blob([source, listen], { type: "text/javascript" }));
    const hired = new Worker(url);
    const told = calib.rest().then((rest) => hired.postMessage({ module: calib.module, rest }));
    // A failed worker is replaced at the next task; its waiting tasks are rejected.
    const dismiss = (why) => {
      hired.terminate();
      URL.revokeObjectURL(url);
      workers.delete(lane);
      for (const [, reject] of asked.values()) reject(why);
      asked.clear();
    };
    hired.onmessage = ({ data: { id, result, error, fatal } }) => {
      const [resolve, reject] = asked.get(id) ?? [];
      if (!asked.delete(id)) return;
      if (error) reject(error); else resolve(result);
      if (fatal) dismiss(error);
    };
    hired.onerror = (event) => dismiss(event.message || "the worker stopped");
    let last = 0;
    const act = (kind, name, width, bytes) => new Promise((resolve, reject) => {
      const id = last += 1;
      asked.set(id, [resolve, reject]);
      told.then(() => hired.postMessage({ id, kind, name, width, bytes }, [bytes.buffer]))
        .catch((error) => { if (asked.has(id)) dismiss(String(error)); });
    });
    return { act, dismiss };
  };
  calib.work = (kind, name, width, bytes) => {
    const lane = OWN.includes(kind) ? kind : "images";
    if (!workers.has(lane)) workers.set(lane, hire(lane));
    return workers.get(lane).act(kind, name, width, bytes);
  };
  calib.dismiss = (kind) => workers.get(kind)?.dismiss("it was cancelled");

  const offline = async () => {
    if (!("serviceWorker" in navigator) || !location.protocol.startsWith("http")) return;
    await navigator.serviceWorker.register("sw.js").catch(() => {});
  };

  const start = async () => {
    if (typeof WebAssembly !== "object") return cannot("has no WebAssembly");
    // A module whose function returns a SIMD vector.
    const vectors = Uint8Array.of(0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 8, 1, 6, 0, 65, 0, 253, 15, 11);
    if (!WebAssembly.validate(vectors)) return cannot("has no WebAssembly SIMD");
    if (!document.createElement("canvas").getContext("webgl2")) return cannot("has no WebGL 2");
    try {
      if (address()) calibRest.address = address();
      calib.module = await WebAssembly.compileStreaming(fetched());
      const { memory } = await wasm_bindgen({ module_or_path: calib.module });
      calib.memory = () => memory.buffer.byteLength;
      begin();
      await calib.rest().catch(() => {});
    } catch (error) {
      if (calib.broken) return;
      trouble("Calib could not be loaded", "The program could not be downloaded completely. Check the network and reload the page.", [reload], String(error?.stack ?? error));
      listKept();
    }
  };
  // Files for offline use are fetched after the app runs.
  start().then(offline);
})();
