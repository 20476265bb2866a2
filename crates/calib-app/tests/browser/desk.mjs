// Simulated operator in a browser: mouse and keys on the page, at coordinates reported by the page.
import assert from "node:assert/strict";
import { createRequire } from "node:module";
import path from "node:path";

const require = createRequire(path.join(process.env.CALIB_NODE_MODULES, "resolve.js"));
const { chromium } = require("playwright-core");

const FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
  "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic"];

export const launch = () => chromium.launch({ executablePath: process.env.CALIB_CHROMIUM, args: FLAGS });

export class Desk {
  /** Opens a page in its own context and collects its errors. */
  static async open(browser, url, { size = [1280, 720], touch = false, keep = null } = {}) {
    const context = keep ?? await browser.newContext({ viewport: { width: size[0], height: size[1] }, hasTouch: touch, acceptDownloads: true });
    const page = await context.newPage();
    const desk = new Desk();
    Object.assign(desk, { context, page, wrong: [], origin: url.startsWith("http") ? new URL(url).origin : "file://" });
    page.on("console", (message) => { if (["error", "warning"].includes(message.type()) && !IGNORED.test(message.text())) desk.wrong.push(message.text()); });
    page.on("pageerror", (error) => desk.wrong.push(String(error)));
    context.on("request", (request) => {
      const to = request.url();
      if (!to.startsWith(desk.origin) && !/^(blob|data):/.test(to)) desk.wrong.push(`request to ${to}`);
    });
    await page.goto(url);
    await page.waitForFunction(() => document.documentElement.dataset.shown, null, { timeout: 180_000 });
    return desk;
  }

  state() { return this.page.evaluate(() => JSON.parse(globalThis.calibState() || "null")); }

  /** Waits until the page's state meets a condition. Limits of time are generous, because other checks run beside this one. */
  async until(what, wanted, seconds = 180) {
    const end = Date.now() + 1000 * seconds;
    for (let state; ; await this.page.waitForTimeout(50)) {
      state = await this.state();
      if (state && wanted(state)) return state;
      assert(Date.now() < end, `${what}: ${JSON.stringify({ ...state, site: undefined })}`);
    }
  }

  /** Waits until all images are read and the site is stored. */
  settled() { return this.until("settled", (state) => state.reading === 0 && !state.behind, 300); }

  /** Waits until the page has drawn a frame with all events so far. A press and a release in one frame would not be a drag. */
  async painted(milliseconds = 40) {
    await this.page.waitForTimeout(milliseconds);
    await this.page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
  }

  /** Returns the centre of the widget whose name starts with `name`. */
  async place(name) {
    const handle = this.page.locator(`#mirror [data-at]`).and(this.page.locator(`[aria-label^="${name}"]`)).first();
    const [x0, y0, x1, y1] = (await handle.getAttribute("data-at", { timeout: 60_000 })).split(" ").map(Number);
    return [0.5 * (x0 + x1), 0.5 * (y0 + y1)];
  }

  async press(name) {
    await this.tap(await this.place(name));
    await this.painted(150);
  }

  /** Clicks at a position of the screen. The button is not held for a frame, which can be long on a busy machine. */
  async tap([x, y]) {
    await this.page.mouse.move(x, y);
    await this.painted();
    await this.page.mouse.down();
    await this.page.mouse.up();
  }

  async key(key) {
    await this.page.keyboard.press(key);
    await this.painted(80);
  }

  /** Returns the screen position of a point in a pane. */
  async screen(pane, [x, y]) {
    const { panes } = await this.state();
    const shown = ["Main", "Half", "Tile"].map((place) => panes.find((p) => p.place === place && p.pane === pane)).find(Boolean);
    assert(shown, `no pane ${pane} of ${panes.map((p) => p.pane)}`);
    const [x0, y0, x1, y1] = shown.rect;
    const up = shown.y_up ? -1 : 1;
    return [0.5 * (x0 + x1) + (x - shown.centre[0]) * shown.zoom, 0.5 * (y0 + y1) + up * (y - shown.centre[1]) * shown.zoom];
  }

  /** Presses at the first point of a pane, passes through the others, and releases at the last. */
  async drag(pane, points, modifier) {
    const places = [];
    for (const point of points) places.push(await this.screen(pane, point));
    const { mouse, keyboard } = this.page;
    await mouse.move(...places[0]);
    await this.painted();
    await mouse.down();
    if (modifier) await keyboard.down(modifier);
    await this.painted();
    for (const place of places.slice(1)) {
      await mouse.move(...place, { steps: 6 });
      await this.painted();
    }
    await mouse.up();
    if (modifier) await keyboard.up(modifier);
    await this.painted();
  }

  /** Opens a site with one simple image. */
  async yard() {
    const still = await this.page.evaluate(() => {
      const canvas = Object.assign(document.createElement("canvas"), { width: 1920, height: 1080 });
      canvas.getContext("2d").fillRect(300, 300, 900, 300);
      return canvas.toDataURL("image/png").split(",")[1];
    });
    const site = { format: "calib-site", version: 1, name: "Yard", cameras: [{ id: "a", image: "frames/a.png", size_px: [1920, 1080] }] };
    await this.drop([["a.png", "image/png", Buffer.from(still, "base64")], ["yard.json", "application/json", JSON.stringify(site)]]);
    await this.until("the site", (state) => state.site.name === "Yard" && state.site.cameras[0].image.startsWith("stored:"));
    await this.settled();
  }

  /** Draws a vertical line on the first camera's image, at a column. */
  async stroke(x) {
    const { generation } = await this.state();
    await this.key("1");
    await this.key("v");
    await this.drag("Image(0)", [[x, 300], [x + 5, 600]]);
    return this.until("one more line", (state) => state.generation > generation);
  }

  async click(pane, point) {
    await this.tap(await this.screen(pane, point));
    // Otherwise the next click would be a double click.
    await this.painted(450);
  }

  /** Drops files: [name, type, bytes or text]. */
  async drop(files) {
    const list = files.map(([name, type, data]) => [name, type, typeof data === "string" ? data : data.toString("base64"), typeof data === "string"]);
    const transfer = await this.page.evaluateHandle((list) => {
      const transfer = new DataTransfer();
      for (const [name, type, data, isText] of list) {
        const bytes = isText ? data : Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
        transfer.items.add(new File([bytes], name, { type }));
      }
      return transfer;
    }, list);
    await this.page.dispatchEvent("#canvas", "drop", { dataTransfer: transfer });
  }

  /** Saves the download started by a press or key, and returns its file name. */
  async download(act, to) {
    const [download] = await Promise.all([this.page.waitForEvent("download", { timeout: 120_000 }), act()]);
    await download.saveAs(to);
    return download.suggestedFilename();
  }

  /** Saves a screenshot of the page, or of a part of it: x, y, width and height. */
  async picture(name, clip) {
    if (process.env.CALIB_PICTURES) await this.page.screenshot({ path: path.join(process.env.CALIB_PICTURES, `${name}.png`), clip });
  }

  fine() { assert.deepEqual(this.wrong, [], "errors or requests of the page"); }
}

// Chromium's warnings about software rendering.
const IGNORED = /GPU stall due to ReadPixels|software WebGL|swiftshader/i;
