// Tests that typed arrays are bit-identical to the core, for every camera, stream and lens, in Node and in a browser.

import type * as Calib from "../../../target/js/calib.js";

const COLUMNS = 21;
const SIGMA_PX = 1.5;

/** Content of the golden files. */
export interface Golden { site: string; cameras: string; points: ArrayBuffer; }

function assert(isTrue: boolean, what: string): void {
  if (!isTrue) throw new Error(what);
}

function throws(work: () => unknown, why: RegExp): void {
  try {
    work();
  } catch (error) {
    return assert(why.test(String(error)), `${error} for ${why}`);
  }
  throw new Error(`nothing thrown for ${why}`);
}

/** Counts the values of two columns that are not bit-identical; NaN equals NaN. */
function mismatches(found: Float64Array | Uint8Array, expected: Float64Array, place: string): number {
  assert(found.length === expected.length, place);
  return expected.reduce((count, value, i) => count + (Object.is(value, found[i]) ? 0 : 1), 0);
}

/** Interleaves columns to rows. */
const rows = (columns: Float64Array[]): Float64Array =>
  Float64Array.from({ length: columns.length * columns[0].length }, (_, i) => columns[i % columns.length][Math.floor(i / columns.length)]);

/** Maps every point of the golden files, and returns a summary. */
export function golden(calib: typeof Calib, files: Golden): string {
  const site = new calib.Site(files.site);
  const values = new Float64Array(files.points);
  const lines = files.cameras.trim().split("\n");
  const count = values.length / lines.length / COLUMNS;
  for (const [index, line] of lines.entries()) {
    const [id, ...fields] = line.split(" ");
    const [origin, fit, width, height, left, top, w, h, plane] = fields.map(Number);
    const options: Calib.CameraOptions = { origin: origin ? "centre" : "corner" };
    if (fit) options.fit = fit === 1 ? "stretch" : "letterbox";
    if (width) options.streamSize = [width, height];
    if (w) options.crop = [left, top, w, h];
    const camera = site.camera(id, options);
    const table = Array.from({ length: COLUMNS }, (_, k) => values.subarray((index * COLUMNS + k) * count, (index * COLUMNS + k + 1) * count));
    const [u, v, x, y, status] = table;
    const check = (found: Float64Array | Uint8Array, expected: Float64Array, what: string): void =>
      assert(mismatches(found, expected, what) === 0, `${id}: ${what}`);
    const floor = camera.toFloor(u, v, plane);
    check(floor.x, x, "x");
    check(floor.y, y, "y");
    check(floor.status, status, "status");
    const covariance = camera.floorCovariance(u, v, SIGMA_PX, plane);
    check(covariance.pixel, rows(table.slice(5, 9)), "the pixel's part");
    check(covariance.calibration, rows(table.slice(9, 13)), "the calibration's part");
    const back = camera.toPixel(x, y, new Float64Array(count).fill(plane));
    check(back.u, table[13], "u");
    check(back.v, table[14], "v");
    check(back.status, table[15], "status of the point");
    check(camera.rays(u, v), rows(table.slice(16, 19)), "rays");
    const straight = camera.undistort(u, v);
    check(straight.u, table[19], "undistorted u");
    check(straight.v, table[20], "undistorted v");
    camera.free();
  }
  const camera = site.camera("camera-0");
  const boxes = camera.boxesToFloor(Float64Array.of(900, 500, 1000, 900), "xyxy");
  const foot = camera.toFloor(Float64Array.of(950), Float64Array.of(900));
  assert(boxes.x[0] === foot.x[0] && boxes.y[0] === foot.y[0] && boxes.status[0] === foot.status[0], "boxes");
  const [width, height] = camera.size;
  const fractions = camera.boxesToFloor(Float64Array.of(950 / width, 700 / height, 100 / width, 400 / height), "yolo");
  assert(Math.abs(fractions.x[0] - foot.x[0]) < 1e-6 && Math.abs(fractions.y[0] - foot.y[0]) < 1e-6, "fractions");
  assert(calib.statusNames()[boxes.status[0]].length > 0, "names of statuses");
  throws(() => site.camera("camera-0", { streamSize: [640, 640] }), /640 x 360/);
  throws(() => site.camera("camera-0", { origin: "center" as "centre" }), /centre/);
  throws(() => site.camera("camera-0", { size: 3 } as Calib.CameraOptions), /streamSize/);
  throws(() => camera.toFloor(Float64Array.of(1), Float64Array.of()), /same length/);
  throws(() => camera.boxesToFloor(Float64Array.of(1, 2, 3), "xywh"), /four/);
  camera.free();
  site.free();
  return `${count * lines.length} points of ${lines.length} cameras are bit-identical to the core`;
}
