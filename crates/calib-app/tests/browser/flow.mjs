// End-to-end test in Chromium: node flow.mjs ADDRESS FILE
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, readdirSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { Desk, launch } from "./desk.mjs";

const [address, file] = process.argv.slice(2);
const scratch = mkdtempSync(path.join(tmpdir(), "calib-browser-"));
const browser = await launch();
const KEYS = { vertical: "v", parallel: "p", perpendicular: "r", equal_length: "e", known_length: "l", upright: "u" };
const done = [];

/** Opens the demonstration without annotations of its first camera. Returns the complete site. */
async function blank(desk) {
  await desk.press("Open the demonstration site");
  const model = (await desk.until("the demonstration", (state) => state.site.cameras?.length > 0)).site;
  await desk.settled();
  await desk.press("Menu");
  await desk.press("Start the tour");
  await desk.until("the tour", (state) => state.site.cameras[0].annotations === undefined || state.site.cameras[0].annotations.length === 0);
  await desk.press("End the tour");
  await desk.settled();
  return model;
}

/** Draws all annotations of the first camera. */
async function draw(desk, model) {
  const entry = model.cameras[0];
  for (const annotation of entry.annotations.filter((annotation) => KEYS[annotation.kind])) {
    await desk.key(KEYS[annotation.kind]);
    const lines = annotation.segments ?? [[annotation.foot, annotation.head]];
    for (const [i, line] of lines.entries()) {
      if (i === 0) await desk.key("w");
      await desk.drag("Image(0)", [line[0], line.at(-1)]);
    }
  }
  await desk.key("f");
  for (const corner of entry.efov_px) await desk.click("Image(0)", corner);
  await desk.key("Enter");
  const groups = entry.annotations.filter((a) => KEYS[a.kind]).length;
  const whole = ({ site: { cameras: [camera] } }) => camera.efov_px && camera.annotations?.length === groups;
  const drawn = (await desk.until("everything drawn", whole)).site.cameras[0];
  assert.equal(drawn.solution?.stage, "partial", JSON.stringify(drawn.error));
}

/** Drags the camera on the plan to its position in the model. */
async function place(desk, model) {
  await desk.key("2");
  await desk.key("q");
  for (let i = 0; i < 4; i += 1) await desk.key("-");
  // The view is fitted to the plan after its image is loaded.
  await desk.settled();
  await desk.painted(300);
  const { position_m: [x, y] } = (await desk.state()).site.cameras[0].solution;
  await desk.drag("Plan", [[x, y], [x + 1, y + 1], model.cameras[0].solution.position_m.slice(0, 2)]);
  const { site } = await desk.until("placed", (state) => state.site.cameras[0].solution?.stage === "placed");
  return site.cameras[0].solution;
}

/** Asserts that all numbers agree, to the difference between native and WebAssembly. */
function same(shown, solved, where = "") {
  if (typeof shown === "number") {
    const off = Math.abs(shown - solved) / Math.max(1e-3, Math.abs(shown), Math.abs(solved));
    assert(off <= 1e-9, `${where}: ${shown} here, ${solved} by calib solve`);
  } else if (shown && typeof shown === "object") {
    for (const key of Object.keys(shown)) same(shown[key], solved?.[key], `${where}/${key}`);
  }
}

async function calibrate(name, url, keep) {
  const desk = await Desk.open(browser, url, { keep });
  console.log(`${name}: first frame after ${await desk.page.evaluate(() => document.documentElement.dataset.shown)} ms`);
  const model = await blank(desk);
  await draw(desk, model);
  const placed = await place(desk, model);
  await desk.picture(`${name}-placed`);
  await desk.settled();
  const site = path.join(scratch, `${name}.json`);
  await desk.key("1");
  assert.equal(await desk.download(() => desk.page.keyboard.press("Control+s"), site), "site.json");
  const saved = JSON.parse(readFileSync(site, "utf8"));
  assert(saved.cameras.every((camera) => /^data:image\/(png|jpeg);base64,/.test(camera.image)), "self-contained");
  const report = JSON.parse(execFileSync(process.env.CALIB, ["solve", site, "--no-refine", "--format", "json"], { maxBuffer: 1 << 28 }));
  const solved = (report.cameras ?? report)[saved.cameras[0].id];
  const keys = ["position_m", "yaw_deg", "pitch_deg", "roll_deg", "focal_px", "sigma", "rms_px", "chi2"];
  for (const key of keys) assert(placed[key] !== undefined, key), same(placed[key], (solved.solution ?? solved)[key], key);
  const before = (await desk.state()).site;
  await desk.page.reload();
  await desk.page.waitForFunction(() => document.documentElement.dataset.shown);
  await desk.painted(800);
  await desk.picture(`${name}-again`);
  await desk.press("Continue");
  const after = (await desk.until("restored", (state) => state.site.cameras?.length > 0)).site;
  assert.deepEqual(after.cameras[0].annotations, before.cameras[0].annotations);
  same(before.cameras.map((camera) => camera.solution), after.cameras.map((camera) => camera.solution), "restored");
  await desk.settled();
  await desk.picture(`${name}-restored`);
  desk.fine();
  return desk;
}

async function hostile(desk) {
  for (const [name, text, words] of [
    ["deep.json", "[".repeat(100000), "deep.json"],
    ["wrong.json", '{"format": "calib-site", "version": 1, "cameras": [{"id": "a", "size_px": [0, -3], "evil": 1}]}', "wrong.json"],
    ["bomb.png", Buffer.from("89504e470d0a1a0a0000000d49484452ffffffffffffffff0806000000", "hex"), null],
    ["virus.exe", "MZ", "virus.exe"],
  ]) {
    await desk.drop([[name, "", text]]);
    const state = await desk.until(name, (state) => state.error);
    assert(!words || state.error.includes(words), state.error);
    // The screen is updated one frame after the state.
    const shown = desk.page.locator("#mirror").getByText(state.error.slice(0, 24)).first();
    await shown.waitFor({ state: "attached", timeout: 60_000 });
    await desk.key("Escape");
    await desk.until("closed", (state) => !state.error);
  }
  desk.fine();
}

/** Drops a site with its images, then images alone, which become cameras. */
async function together() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  const still = await desk.page.evaluate(async () => {
    const canvas = Object.assign(document.createElement("canvas"), { width: 640, height: 360 });
    canvas.getContext("2d").fillRect(100, 100, 300, 100);
    return canvas.toDataURL("image/png").split(",")[1];
  });
  const bytes = Buffer.from(still, "base64");
  const site = { format: "calib-site", version: 1, name: "Yard", cameras: [{ id: "a", image: "frames/a.png", size_px: [640, 360] }] };
  await desk.drop([["a.png", "image/png", bytes], ["yard.json", "application/json", JSON.stringify(site)]]);
  await desk.until("the site", (state) => state.site.name === "Yard" && state.site.cameras[0].image.startsWith("stored:"));
  await desk.drop([["b.png", "image/png", Buffer.from(bytes)], ["c.png", "image/png", Buffer.concat([bytes, Buffer.from([0])])]]);
  await desk.until("two more cameras", (state) => state.site.cameras?.length === 3);
  await desk.settled();
  desk.fine();
  await desk.context.close();
}

/** Opens one site in two tabs: the second to write continues with a copy. */
async function tabs(keep) {
  const [a, b] = [await Desk.open(browser, `${address}?test=1`, { keep }), await Desk.open(browser, `${address}?test=1`, { keep })];
  for (const desk of [a, b]) {
    await desk.page.bringToFront();
    await desk.press("Continue");
    await desk.until("open", (state) => state.site.cameras?.length > 0);
    await desk.settled();
  }
  await a.page.bringToFront();
  await a.stroke(500);
  await a.settled();
  await b.page.bringToFront();
  await b.stroke(900);
  await b.until("a note", (state) => /another tab/.test(state.note));
  await b.settled();
  const kept = await a.page.evaluate(() => calib.store.list());
  assert(kept.length >= 2, "both are kept");
  a.fine();
  b.fine();
  await a.page.close();
  await b.page.close();
}

async function quota() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.yard();
  const session = await desk.context.newCDPSession(desk.page);
  await session.send("Storage.overrideQuotaForOrigin", { origin: new URL(address).origin, quotaSize: 10 });
  await desk.stroke(500);
  const state = await desk.until("an error", (state) => state.error);
  assert.match(state.error, /no space left|could not store/);
  await desk.picture("quota");
  const site = path.join(scratch, "quota.json");
  await desk.download(() => desk.page.keyboard.press("Control+s"), site);
  assert(JSON.parse(readFileSync(site, "utf8")).cameras[0].annotations.length > 0);
  desk.fine();
  await desk.context.close();
}

async function panic() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.yard();
  await desk.stroke(500);
  const before = (await desk.settled()).site;
  await desk.page.evaluate(() => { calib.queue.push({ command: "panic" }); calib.wake(); });
  await desk.page.getByText("Calib stopped").waitFor();
  await desk.picture("panic");
  const site = path.join(scratch, "panic.json");
  await desk.download(() => desk.page.getByText("Download the site").click(), site);
  assert.deepEqual(JSON.parse(readFileSync(site, "utf8")).cameras[0].annotations, before.cameras[0].annotations);
  await desk.page.getByText("Reload the page").click();
  await desk.page.waitForFunction(() => document.documentElement.dataset.shown);
  await desk.painted(500);
  await desk.press("Continue");
  const after = (await desk.until("restored", (state) => state.site.cameras?.length > 0)).site;
  assert.deepEqual(after.cameras[0].annotations, before.cameras[0].annotations);
  await desk.context.close();
}

async function context() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.yard();
  await desk.stroke(500);
  const before = await desk.settled();
  await desk.page.evaluate(() => document.querySelector("canvas").getContext("webgl2").getExtension("WEBGL_lose_context").loseContext());
  await desk.page.getByText("The graphics context was lost").waitFor();
  await desk.picture("context-lost");
  await desk.page.getByText("The graphics context was lost").waitFor({ state: "hidden", timeout: 60_000 });
  await desk.painted(500);
  await desk.stroke(900);
  await desk.settled();
  await desk.picture("context-back");
  const after = await desk.state();
  assert.equal(after.generation, before.generation + 1, "the app goes on, undo and all");
  await desk.context.close();
}

/** Opens, draws and solves with the first part of the program only. The second part, which reads images, is loaded later;
 * a failed download is repeated. */
async function alone() {
  const context = await browser.newContext({ viewport: { width: 1280, height: 720 }, serviceWorkers: "block" });
  let asked = 0, release;
  const released = new Promise((resolve) => { release = resolve; });
  await context.route("**/rest-*.wasm", async (route) => {
    asked += 1;
    if (asked === 1) return route.abort();
    await released;
    return route.continue();
  });
  const desk = await Desk.open(browser, `${address}?test=1`, { keep: context });
  await desk.press("Open the demonstration site");
  const opened = await desk.until("the demonstration", (state) => state.site.cameras.length === 6);
  assert(opened.reading > 0, "images wait for the second part");
  await desk.stroke(500);
  assert.equal(await desk.page.evaluate(() => calibRest.here), false, "the second part is not loaded");
  const expected = /net::ERR_FAILED|Service Worker registration blocked/;
  assert.deepEqual(desk.wrong.splice(0).filter((message) => !expected.test(message)), []);
  release();
  await desk.settled();
  assert.equal(await desk.page.evaluate(() => calibRest.here), true, "the second part is loaded");
  assert.equal(asked, 2);
  desk.fine();
  await context.close();
}

/** Opens the page offline after one visit. */
async function offline() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.page.evaluate(() => navigator.serviceWorker.ready);
  await desk.context.setOffline(true);
  await desk.page.reload();
  await desk.page.waitForFunction(() => document.documentElement.dataset.shown, null, { timeout: 180_000 });
  await desk.context.close();
}

/** Installs a newer version: an open page keeps its files, and the next page gets the new ones. */
async function versions() {
  const folder = path.dirname(file);
  const files = new Map(readdirSync(folder).map((name) => [name, readFileSync(path.join(folder, name))]));
  // Some hosts send no type for WebAssembly.
  const types = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml" };
  const server = createServer((request, response) => {
    const name = new URL(request.url, "http://localhost").pathname.slice(1) || "index.html";
    const bytes = files.get(name);
    const type = types[path.extname(name)] ?? "application/octet-stream";
    response.writeHead(bytes ? 200 : 404, { "Content-Type": type, "Cache-Control": "no-cache" });
    response.end(bytes);
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const url = `http://127.0.0.1:${server.address().port}/?test=1`;
  const shown = (page) => page.waitForFunction(() => document.documentElement.dataset.shown, null, { timeout: 180_000 });
  const programs = (page) => page.evaluate(() => performance.getEntriesByType("resource").map((entry) => entry.name.split("/").at(-1)).filter((name) => /^calib-.*\.wasm$/.test(name)));

  const desk = await Desk.open(browser, url);
  await desk.page.evaluate(async () => { await calib.rest(); });
  await desk.page.evaluate(() => navigator.serviceWorker.ready);
  await desk.page.reload();
  await shown(desk.page);
  // The program gets another name, and the old file is removed from the server.
  const program = [...files.keys()].find((name) => /^calib-.*\.wasm$/.test(name));
  const next = program.replace(".wasm", "-next.wasm");
  files.set(next, files.get(program));
  files.delete(program);
  for (const name of [...files.keys()].filter((name) => /\.(html|js)$/.test(name))) {
    const text = files.get(name).toString().replaceAll(program, next);
    files.set(name, Buffer.from(text.replace(/const CACHE = "calib-[^"]*"/, 'const CACHE = "calib-next"')));
  }
  await desk.page.evaluate(async () => (await navigator.serviceWorker.getRegistration()).update());
  await desk.page.waitForFunction(async () => (await navigator.serviceWorker.getRegistration()).waiting, null, { timeout: 180_000 });
  assert.equal(await desk.page.evaluate(async (name) => (await fetch(name)).status, program), 200, "the open page has its own files");
  await desk.page.reload();
  await shown(desk.page);
  assert.deepEqual([...new Set(await programs(desk.page))], [program], "reloaded while a newer version waits");
  desk.fine();
  await desk.page.close();

  const end = Date.now() + 120_000;
  for (let kept = []; kept.join() !== "calib-next";) {
    assert(Date.now() < end, `the old version is still used: ${kept}`);
    await new Promise((resolve) => setTimeout(resolve, 300));
    const again = await Desk.open(browser, url, { keep: desk.context });
    kept = await again.page.evaluate(() => caches.keys());
    if (kept.join() === "calib-next") {
      await again.page.reload();
      await shown(again.page);
      assert.deepEqual([...new Set(await programs(again.page))], [next]);
      again.fine();
    }
    await again.page.close();
  }
  await desk.context.close();
  server.close();
}

async function memory() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  // Created and dropped within the page, so that copies in the test are not measured.
  await desk.page.evaluate(async () => {
    const canvas = Object.assign(document.createElement("canvas"), { width: 1920, height: 1080 });
    const pen = canvas.getContext("2d");
    const transfer = new DataTransfer();
    for (let i = 0; i < 16; i += 1) {
      for (let k = 0; k < 400; k += 1) {
        pen.fillStyle = `hsl(${(k * 47 + i * 20) % 360} 60% ${20 + (k % 60)}%)`;
        pen.fillRect((k * 193) % 1920, (k * 71 + 13 * i) % 1080, 120, 80);
      }
      const blob = await new Promise((resolve) => canvas.toBlob(resolve, "image/jpeg", 0.9));
      transfer.items.add(new File([blob], `camera-${i}.jpg`, { type: "image/jpeg" }));
    }
    document.getElementById("canvas").dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
  });
  await desk.until("16 cameras", (state) => state.site.cameras?.length === 16, 120);
  await desk.key("3");
  await desk.settled();
  await desk.picture("sixteen");
  const session = await browser.newBrowserCDPSession();
  const resident = (id) => Number(/VmRSS:\s+(\d+)/.exec(readFileSync(`/proc/${id}/status`, "utf8"))?.[1] ?? 0) / 1024;
  const measured = async () => {
    const { processInfo } = await session.send("SystemInfo.getProcessInfo");
    return Math.max(...processInfo.filter((p) => p.type === "renderer").map((p) => resident(p.id)));
  };
  // The browser frees the memory of decoded images some time after their last use.
  let renderer = await measured();
  for (const end = Date.now() + 60_000; renderer >= 500 && Date.now() < end; renderer = await measured()) await desk.page.waitForTimeout(1000);
  const own = await desk.page.evaluate(() => calib.memory() / 1e6);
  console.log(`16 cameras of 1920x1080: ${renderer.toFixed(0)} MB resident in the page's process, ${own.toFixed(0)} MB of WebAssembly memory`);
  assert(renderer < 500, `${renderer} MB`);
  desk.fine();
  await desk.context.close();
}

/** Refines a large site: the page stays responsive, the task can be cancelled, and it is one undo step. */
async function refine() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.press("Open the demonstration site");
  const { site } = await desk.until("the demonstration", (state) => state.site.cameras?.length > 0);
  const shop = site.cameras.slice(0, 3).map(({ image, error, ...camera }) => camera);
  const copies = Array.from({ length: 12 }, (_, i) => i);
  const cameras = copies.flatMap((i) => shop.map((camera) => ({ ...camera, id: `${camera.id} ${i}` })));
  const links = copies.flatMap((i) => site.links.filter((link) => link.seen.every(({ camera }) => shop.some(({ id }) => id === camera)))
    .map((link) => ({ ...link, id: `${link.id} ${i}`, seen: link.seen.map((seen) => ({ ...seen, camera: `${seen.camera} ${i}` })) })));
  const big = { ...site, name: "Big", cameras, links, marks: [], distances: [], plan: undefined, solution: undefined };
  await desk.drop([["big.json", "application/json", JSON.stringify(big)]]);
  await desk.until("the big site", (state) => state.site.name === "Big");
  const refined = (state) => state.site.cameras.filter((camera) => camera.solution?.stage === "refined").length;
  // A worker that does not end: the page stays responsive, and the cancel button works.
  await desk.page.evaluate(() => { globalThis.own = calib.work; calib.work = () => new Promise(() => {}); });
  await desk.key("F9");
  await desk.until("under way", (state) => state.refining);
  await desk.picture("refining");
  await desk.press("Cancel the running task");
  const stopped = await desk.until("stopped", (state) => !state.refining);
  assert.match(stopped.note, /No camera pose was changed/);
  assert.equal(refined(stopped), 0);
  await desk.page.evaluate(() => { calib.work = globalThis.own; });
  await desk.key("F9");
  const done = await desk.until("refined", (state) => !state.refining && refined(state) > 0, 300);
  assert.equal(refined(done), cameras.length);
  await desk.key("Control+z");
  await desk.until("taken back", (state) => refined(state) === 0);
  desk.fine();
  await desk.context.close();
}

/** Runs the automatic calibration in a worker with one key, cancels it, and accepts its lines with another key as one undo step. */
async function propose() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.press("Open the demonstration site");
  await desk.settled();
  const drawn = (state) => state.site.cameras[0].annotations.length;
  const before = drawn(await desk.state());
  // A worker that does not end: the page stays responsive, and the cancel button works.
  await desk.page.evaluate(() => { globalThis.own = calib.work; calib.work = () => new Promise(() => {}); });
  await desk.key("Shift+P");
  await desk.until("under way", (state) => state.proposing);
  await desk.press("Cancel the running task");
  const stopped = await desk.until("stopped", (state) => !state.proposing);
  assert.match(stopped.note, /No lines were added/);
  await desk.page.evaluate(() => { calib.work = globalThis.own; });
  const start = Date.now();
  await desk.key("Shift+P");
  const { proposed } = await desk.until("automatic calibration", (state) => !state.proposing && state.proposed);
  console.log(`automatic calibration of 1920x1080 in ${((Date.now() - start) / 1000).toFixed(1)} s: ${proposed.verdict}, ${proposed.lines} lines`);
  assert.notEqual(proposed.verdict, "none");
  assert(proposed.lines > 4, `${proposed.lines} lines`);
  assert.equal(drawn(await desk.state()), before);
  await desk.picture("proposed");
  await desk.key("Enter");
  await desk.until("drawn", (state) => !state.proposed && drawn(state) > before);
  await desk.key("Control+z");
  await desk.until("restored by undo", (state) => state.proposed && drawn(state) === before);
  await desk.key("Escape");
  await desk.until("dismissed", (state) => !state.proposed);
  desk.fine();
  await desk.context.close();
}

/** Calibrates and places three dropped images in workers with one key; cancels it first, and takes it back in two steps. */
async function all() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  const names = ["shop-1.png", "shop-2.png", "shop-3.png"];
  const images = await desk.page.evaluate(async (names) => {
    const base64 = (bytes) => btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
    return Promise.all(names.map(async (name) => base64(await calib.picture(name))));
  }, names);
  await desk.drop(names.map((name, index) => [name.replace("png", "jpg"), "image/jpeg", Buffer.from(images[index], "base64")]));
  await desk.until("three cameras", (state) => state.site.cameras?.length === 3);
  await desk.settled();
  const drawn = (state) => state.site.cameras.filter((camera) => camera.annotations?.length).length;
  const placed = (state) => state.site.cameras.filter((camera) => camera.placement?.estimated).length;
  await desk.key("Shift+A");
  await desk.until("the first image", (state) => state.automatic?.startsWith("calibrating"));
  await desk.press("Cancel the running task");
  const stopped = await desk.until("stopped", (state) => !state.automatic);
  assert.match(stopped.note, /no camera was placed/);
  // Images that were calibrated before the click keep their calibration.
  const kept = drawn(stopped);
  assert(kept < 3 && placed(stopped) === 0, `${kept} calibrated`);
  const start = Date.now();
  await desk.key("Shift+A");
  await desk.until("placed", (state) => !state.automatic && placed(state) === 3);
  console.log(`three images calibrated and placed in ${((Date.now() - start) / 1000).toFixed(1)} s`);
  await desk.picture("all");
  await desk.key("Control+z");
  await desk.until("the calibrations remain", (state) => placed(state) === 0 && drawn(state) === 3);
  await desk.key("Control+z");
  await desk.until("everything is taken back", (state) => drawn(state) === kept);
  desk.fine();
  await desk.context.close();
}

/** Converts an SVG drawing to the image of the plan; reads the scale of a DXF, and refuses a PDF with advice. */
async function drawing() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.yard();
  const load = async (text, name = "plan.svg", mimeType = "image/svg+xml") => {
    await desk.press("Menu");
    const [chooser] = await Promise.all([desk.page.waitForEvent("filechooser"), desk.press("Load a floor plan")]);
    await chooser.setFiles({ name, mimeType, buffer: Buffer.from(text) });
  };
  await load('<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="20mm"><rect width="100" height="30" style="fill: #346"/></svg>');
  const { site } = await desk.until("the plan", (state) => state.site.plan?.image?.startsWith("stored:"));
  await desk.settled();
  assert(site.plan, "a plan");
  await desk.key("2");
  await desk.painted(400);
  await desk.picture("drawing");
  await desk.settled();
  const saved = path.join(scratch, "drawing.json");
  await desk.key("1");
  await desk.download(() => desk.page.keyboard.press("Control+s"), saved);
  const { image } = JSON.parse(readFileSync(saved, "utf8")).plan;
  const png = Buffer.from(image.replace("data:image/png;base64,", ""), "base64");
  assert.deepEqual([png.readUInt32BE(16), png.readUInt32BE(20)], [3072, 1024], "the size of the image");
  const colours = await desk.page.evaluate(async (image) => {
    const picture = Object.assign(new Image(), { src: image });
    await picture.decode();
    const canvas = Object.assign(document.createElement("canvas"), { width: picture.width, height: picture.height });
    const pen = canvas.getContext("2d", { willReadFrequently: true });
    pen.drawImage(picture, 0, 0);
    return [[100, 100], [3000, 1000]].map(([x, y]) => [...pen.getImageData(x, y, 1, 1).data]);
  }, image);
  assert.deepEqual(colours, [[0x33, 0x44, 0x66, 255], [255, 255, 255, 255]], "drawn on white");
  await load('<svg xmlns="http://www.w3.org/2000/svg" width="3" height="4"><broken');
  const failed = await desk.until("an error", (state) => state.error);
  assert.match(failed.error, /plan.svg: .*SVG drawing/);
  await load("%PDF-1.4\n", "plan.pdf", "application/pdf");
  const refused = await desk.until("another error", (state) => state.error?.includes("plan.pdf"));
  assert.match(refused.error, /PDF plans are not supported here/);
  // A hall of 20 m x 12 m, in millimetres.
  const line = (...ends) => ["0", "LINE", "8", "WALLS", ...ends.flatMap((value, k) => [[10, 20, 11, 21][k], value])].join("\n");
  const lines = [line(0, 0, 2e4, 0), line(2e4, 0, 2e4, 12e3), line(2e4, 12e3, 0, 12e3), line(0, 12e3, 0, 0)].join("\n");
  const dxf = `0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n${lines}\n0\nENDSEC\n0\nEOF\n`;
  await load(dxf, "hall.dxf", "image/vnd.dxf");
  const hall = await desk.until("the DXF", (state) => state.site.plan?.metres_per_px === 0.005);
  assert.deepEqual(hall.site.plan.origin_px, [24, 2424], "the origin of the drawing");
  await desk.key("2");
  await desk.painted(800);
  await desk.picture("drawing-dxf");
  desk.fine();
  await desk.context.close();
}

/** Takes a frame and the scene without moving objects from a video, with the decoder of the browser. */
async function video() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  const clip = readFileSync(new URL("../../../calib-video/tests/clips/h264.mp4", import.meta.url));
  const open = (name, bytes = clip) => desk.drop([[name, "video/mp4", bytes]]);
  /** Brightness of the square and of the background in the image of a camera. */
  const pixels = async (index, points) => {
    const saved = path.join(scratch, `video-${index}.json`);
    await desk.download(() => desk.page.keyboard.press("Control+s"), saved);
    return desk.page.evaluate(async ([image, points]) => {
      const picture = Object.assign(new Image(), { src: image });
      await picture.decode();
      const canvas = Object.assign(document.createElement("canvas"), { width: picture.width, height: picture.height });
      const pen = canvas.getContext("2d", { willReadFrequently: true });
      pen.drawImage(picture, 0, 0);
      return points.map(([x, y]) => pen.getImageData(x, y, 1, 1).data[1]);
    }, [JSON.parse(readFileSync(saved, "utf8")).cameras[index].image, points]);
  };
  await open("door_20260501_083005.mp4");
  await desk.press("Frame at 1.25");
  await desk.painted(1000);
  await desk.picture("video");
  await desk.press("Use this image");
  const first = await desk.until("a camera", (state) => state.site.cameras?.length === 1);
  assert.match(first.site.cameras[0].id, /^door_20260501_083006\.250$/);
  assert.deepEqual(first.site.cameras[0].size_px, [96, 64]);
  await desk.settled();
  await open("yard.mp4");
  await desk.press("Remove moving objects");
  await desk.press("Mark changed pixels");
  await desk.picture("video-empty");
  await desk.press("Use this image");
  await desk.until("two cameras", (state) => state.site.cameras?.length === 2);
  await desk.settled();
  // The square moves through the rows 24 to 40; the background has the brightness 40 + x + y / 2.
  for (const [k, value] of (await pixels(1, [[20, 32], [60, 32]])).entries()) {
    assert(Math.abs(value - [76, 116][k]) <= 8, `background ${value}`);
  }
  await open("cut.mp4", clip.subarray(0, 600));
  await desk.place("cut.mp4 cannot be decoded");
  await desk.key("Escape");
  desk.fine();
  await desk.context.close();
}

/** Tests touch: a long press is a right click, and two fingers zoom. */
async function touch() {
  const desk = await Desk.open(browser, `${address}?test=1`, { touch: true, size: [1024, 768] });
  await desk.yard();
  await desk.stroke(500);
  await desk.key("q");
  const session = await desk.context.newCDPSession(desk.page);
  const fingers = (type, points) => session.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
  const on = await desk.screen("Image(0)", [502.5, 450]);
  await fingers("touchStart", [on]);
  await desk.painted(1200);
  await fingers("touchEnd", []);
  await desk.painted(300);
  await desk.picture("touch");
  await desk.press("Delete the selection");
  await desk.until("deleted", (state) => !state.site.cameras[0].annotations?.length);
  const zoom = async () => (await desk.state()).panes.find(({ pane }) => pane === "Image(0)").zoom;
  const before = await zoom();
  const [x, y] = on;
  await fingers("touchStart", [[x - 20, y], [x + 20, y]]);
  for (let d = 25; d <= 80; d += 5) await fingers("touchMove", [[x - d, y], [x + d, y]]);
  await fingers("touchEnd", []);
  await desk.painted(300);
  const after = await zoom();
  assert(after > 2 * before, `${before} to ${after}`);
  assert(!(await desk.state()).site.cameras[0].annotations?.length, "two fingers draw nothing");
  // Also with a drawing tool, and if the second finger comes later.
  await desk.key("v");
  const { generation } = await desk.state();
  await fingers("touchStart", [[x - 20, y]]);
  await desk.painted(120);
  await fingers("touchStart", [[x - 20, y], [x + 20, y]]);
  for (let d = 25; d <= 80; d += 5) await fingers("touchMove", [[x - d, y], [x + d, y]]);
  await fingers("touchEnd", [[x - 80, y]]);
  await fingers("touchMove", [[x - 120, y + 90]]);
  await fingers("touchEnd", []);
  await desk.painted(300);
  assert.equal((await desk.state()).generation, generation, "a pinch draws nothing with a drawing tool");
  desk.fine();
  await desk.context.close();
}

/** Forbids storage, as some private windows do: a message is shown, and the site can be downloaded. */
async function forbidden() {
  const context = await browser.newContext({ viewport: { width: 1280, height: 720 }, acceptDownloads: true });
  await context.addInitScript(() => {
    const refuse = () => { throw new DOMException("The operation is insecure.", "SecurityError"); };
    Object.defineProperty(globalThis, "indexedDB", { value: { open: refuse, deleteDatabase: refuse } });
  });
  const desk = await Desk.open(browser, `${address}?test=1`, { keep: context });
  await desk.yard();
  await desk.stroke(500);
  const state = await desk.until("an error", (state) => state.error);
  assert.match(state.error, /store/);
  await desk.picture("forbidden");
  const site = path.join(scratch, "forbidden.json");
  await desk.download(() => desk.page.keyboard.press("Control+s"), site);
  assert(JSON.parse(readFileSync(site, "utf8")).cameras[0].annotations.length > 0);
  await context.close();
}

/** Shows a message in browsers that cannot run the app. */
async function unable() {
  const lacks = async (what, take) => {
    const context = await browser.newContext({ viewport: { width: 1280, height: 720 } });
    await context.addInitScript(take);
    const page = await context.newPage();
    await page.goto(address);
    await page.getByText("Calib cannot run in this browser").waitFor();
    await page.getByText(what, { exact: false }).waitFor();
    await context.close();
  };
  await lacks("no WebGL 2", () => {
    const own = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) { return /^webgl/.test(kind) ? null : own.call(this, kind, ...more); };
  });
  await lacks("no WebAssembly SIMD", () => { WebAssembly.validate = () => false; });
}

/** Compares the time of a solve during a drag with the native time. */
async function pace() {
  const desk = await Desk.open(browser, `${address}?test=1`);
  await desk.press("Open the demonstration site");
  await desk.settled();
  const here = await desk.page.evaluate(() => calibSolve(200));
  const ratio = here / Number(process.env.CALIB_NATIVE_MS);
  console.log(`web_solve_ratio ${ratio.toFixed(2)} (${here.toFixed(3)} ms here, ${Number(process.env.CALIB_NATIVE_MS).toFixed(3)} ms natively)`);
  assert(ratio <= 3, `${ratio} times the native time`);
  await desk.context.close();
}

const only = process.env.CALIB_ONLY?.split(",");
const step = async (name, work) => {
  if (only && !only.includes(name)) return;
  const start = Date.now();
  await work();
  console.log(`${name}: ${((Date.now() - start) / 1000).toFixed(1)} s`);
  done.push(name);
};
await step("served", async () => {
  const desk = await calibrate("served", `${address}?test=1`);
  await hostile(desk);
  const keep = desk.context;
  await desk.page.close();
  await tabs(keep);
  await keep.close();
});
await step("single file", async () => (await calibrate("file", `${pathToFileURL(file)}?test=1`)).context.close());
await step("together", together);
await step("quota", quota);
await step("panic", panic);
await step("context", context);
await step("alone", alone);
await step("offline", offline);
await step("versions", versions);
await step("refine", refine);
await step("propose", propose);
await step("all", all);
await step("drawing", drawing);
await step("video", video);
await step("touch", touch);
await step("forbidden", forbidden);
await step("unable", unable);
await step("memory", memory);
// Times of an unoptimised build are misleading.
if (process.env.CALIB_NATIVE_MS) await step("pace", pace);
else console.log("pace: not measured; cargo run --release -p xtask --features all -- browser measures it");
await browser.close();
rmSync(scratch, { recursive: true });
assert.deepEqual(only?.filter((name) => !done.includes(name)) ?? [], [], "no such scenarios");
