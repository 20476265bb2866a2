//! Development commands.

mod accuracy;

use accuracy::Extent;

fn main() {
    let arg =
        |i: usize, default: usize| std::env::args().nth(i).and_then(|a| a.parse().ok()).unwrap_or(default);
    accuracy::run(&Extent { scenes: arg(1, 40), draws: arg(2, 12) });
}
