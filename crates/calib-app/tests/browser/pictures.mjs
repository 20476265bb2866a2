// Pictures of the app for the README and the guide: node pictures.mjs ADDRESS
//
// The folder CALIB_DEMO contains the images of the demonstration and its site, as site.json.
import { readFileSync } from "node:fs";
import path from "node:path";
import { Desk, launch } from "./desk.mjs";

const [address] = process.argv.slice(2);
const demo = (name) => readFileSync(path.join(process.env.CALIB_DEMO, name));
const model = JSON.parse(demo("site.json"));
const [shop, barn] = ["shop-1", "barn"].map((id) => model.cameras.find((camera) => camera.id === id));
const browser = await launch();
const KEYS = { vertical: "v", parallel: "p", perpendicular: "r", known_length: "l" };

/** Returns the lines of a kind in the demonstration, group by group. */
const lines = (camera, kind) => camera.annotations.filter((annotation) => annotation.kind === kind).map((annotation) => annotation.segments);

/** Opens a new site with the image of one camera of the demonstration. */
async function image(desk, camera) {
  await desk.drop([[camera.image, "image/jpeg", demo(camera.image)]]);
  await desk.until("the image", (state) => state.site.cameras?.length === 1);
  await desk.settled();
  await desk.key("1");
  await away(desk);
}

/** Moves the pointer to a place without hints, and waits until the view is drawn. */
async function away(desk) {
  await desk.page.mouse.move(560, 20);
  await desk.page.waitForTimeout(350);
}

/** Draws the lines of the shop one by one: the ± shrinks, and the grid fits the floor. */
async function moving() {
  const desk = await Desk.open(browser, `${address}?test=1`, { size: [1120, 640] });
  await image(desk, shop);
  let count = 0;
  const frame = async () => {
    await away(desk);
    await desk.picture(`moving-${String(count).padStart(2, "0")}`, { x: 192, y: 40, width: 928, height: 572 });
    count += 1;
  };
  await frame();
  const [first, second] = lines(shop, "parallel");
  const groups = [["vertical", lines(shop, "vertical")[0].slice(0, 3)], ["parallel", first.slice(0, 3)], ["parallel", second.slice(0, 3)], ["perpendicular", lines(shop, "perpendicular")[0]]];
  for (const [index, [kind, drawn]] of groups.entries()) {
    await desk.key(KEYS[kind]);
    if (index > 0) await desk.key("w");
    for (const line of drawn) {
      await desk.drag("Image(0)", line);
      await frame();
    }
    if (index === 1) await desk.picture("first-lines");
  }
  await desk.key("f");
  for (const corner of shop.efov_px) await desk.click("Image(0)", corner);
  await desk.key("Enter");
  await desk.key("q");
  await desk.key("Escape");
  await frame();
  await desk.picture("first-result");
  desk.fine();
  await desk.context.close();
}

/** Shows the complete demonstration. */
async function views() {
  const desk = await Desk.open(browser, `${address}?test=1`, { size: [1280, 760] });
  await desk.page.waitForTimeout(600);
  await desk.picture("start", { x: 240, y: 110, width: 800, height: 490 });
  await desk.press("Open the demonstration site");
  await desk.until("the demonstration", (state) => state.site.cameras?.length === model.cameras.length);
  await desk.settled();
  for (const [key, name] of [["2", "plan"], ["3", "all-cameras"]]) {
    await desk.key(key);
    await desk.settled();
    await away(desk);
    await desk.picture(name);
  }
  await desk.key("2");
  await desk.press("Coverage");
  await desk.page.waitForTimeout(2500);
  await away(desk);
  await desk.picture("coverage");
  desk.fine();
  await desk.context.close();
}

/** Returns the part of a line between two shares of its length. */
const part = ([[u0, v0], [u1, v1]], from, to) => [from, to].map((share) => [u0 + share * (u1 - u0), v0 + share * (v1 - v0)]);

/** Draws a good and a bad example of each kind of line. */
async function examples() {
  const [along, across] = lines(shop, "parallel");
  const vertical = lines(shop, "vertical")[0];
  const equal = lines(shop, "equal_length")[0];
  const straight = barn.annotations.filter((annotation) => annotation.kind === "straight").map((annotation) => annotation.points);
  const bad = {
    vertical: [part(vertical[2], 0.3, 0.6), part(vertical[4], 0.3, 0.6)],
    parallel: [part(along[1], 0.4, 0.6), part(along[3], 0.5, 0.65)],
    perpendicular: [part(along[1], 0.5, 0.65), part(across[2], 0.4, 0.5)],
    equal_length: [equal[1], equal[3]],
    straight: straight.slice(5, 6).map((line) => line.slice(2)),
  };
  const good = {
    vertical: vertical.slice(0, 4),
    parallel: along,
    perpendicular: lines(shop, "perpendicular")[0],
    equal_length: equal.slice(0, 4),
    straight: straight.slice(0, 4),
  };
  const desk = await Desk.open(browser, `${address}?test=1`, { size: [1120, 640] });
  for (const [quality, of] of [["good", good], ["bad", bad]]) {
    for (const [kind, drawn] of Object.entries(of)) {
      const { id, image, size_px } = kind === "straight" ? barn : shop;
      const groups = kind === "straight" ? drawn.map((points) => ({ kind, points })) : [{ kind, segments: drawn }];
      const site = { format: "calib-site", version: 1, name: `${quality} ${kind}`, cameras: [{ id, image, size_px, annotations: groups }] };
      await desk.drop([[image, "image/jpeg", demo(image)], ["site.json", "application/json", JSON.stringify(site)]]);
      await desk.until("the site", (state) => state.site.name === site.name);
      await desk.settled();
      await desk.key("1");
      // Without the grid and the horizon of an uncertain solution.
      for (const layer of ["Grid", "Horizon", "Guide"]) if (of === good && kind === "vertical") await desk.press(layer);
      await away(desk);
      const [[x, y], [right, lower]] = [await desk.screen("Image(0)", [0, 0]), await desk.screen("Image(0)", size_px)];
      await desk.picture(`${kind}-${quality}`, { x, y, width: right - x, height: lower - y });
    }
  }
  desk.fine();
  await desk.context.close();
}

const only = process.env.CALIB_ONLY;
for (const [name, take] of Object.entries({ moving, views, examples })) if (!only || only === name) await take();
await browser.close();
