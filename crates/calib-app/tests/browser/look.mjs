// Screenshots of every screen in three sizes, for inspection: node look.mjs URL
import { Desk, launch } from "./desk.mjs";

const [url] = process.argv.slice(2);
const browser = await launch();
for (const size of [[1280, 720], [1920, 1080], [390, 844]]) {
  const name = (screen) => `${size.join("x")}-${screen}`;
  const desk = await Desk.open(browser, `${url}?test=1`, { size, touch: size[0] < 500 });
  console.log(name("start"), "shown after", await desk.page.evaluate(() => document.documentElement.dataset.shown), "ms");
  await desk.page.waitForTimeout(500);
  await desk.picture(name("start"));
  await desk.press("Open the demonstration site");
  await desk.settled();
  await desk.page.waitForTimeout(500);
  for (const [key, screen] of [["1", "image"], ["2", "plan"], ["3", "all"], ["4", "scene"]]) {
    await desk.key(key);
    await desk.settled();
    await desk.page.waitForTimeout(400);
    await desk.picture(name(screen));
  }
  console.log(desk.wrong.join("\n"));
  await desk.context.close();
}
await browser.close();
