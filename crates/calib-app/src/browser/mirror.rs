//! Widget tree as invisible HTML, for screen readers and tests.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::time::Duration;

use egui::accesskit::{Live, Node, NodeId, Role, Toggled, TreeUpdate};
use egui::{Context, FullOutput, Plugin};
use serde_json::{Value, json};

use crate::platform::web::page;

/// Shortest interval between two updates of the page, in seconds.
const MIN_UPDATE_INTERVAL_S: f64 = 0.1;

/// Plugin that sends changes of the widget tree to the page.
#[derive(Debug, Default)]
pub(crate) struct Mirror {
    /// Hash of the last update that was sent, and its time in seconds.
    sent: (u64, f64),
    /// Whether each node that is sent contains the rectangle of its widget; tests need the rectangles.
    includes_rects: bool,
}

impl Mirror {
    /// Creates a mirror, which sends the rectangles of widgets if `includes_rects` is set.
    pub(crate) fn new(includes_rects: bool) -> Self {
        Self { includes_rects, ..Self::default() }
    }
}

impl Plugin for Mirror {
    fn debug_name(&self) -> &'static str {
        "mirror"
    }

    fn setup(&mut self, ctx: &Context) {
        ctx.enable_accesskit();
    }

    fn output_hook(&mut self, ctx: &Context, output: &mut FullOutput) {
        let Some(update) = output.platform_output.accesskit_update.take() else { return };
        let now = ctx.input(|i| i.time);
        let rest = MIN_UPDATE_INTERVAL_S - (now - self.sent.1);
        if rest > 0.0 {
            ctx.request_repaint_after(Duration::from_secs_f64(rest));
            return;
        }
        let text = tree(&update, self.includes_rects).to_string();
        let mut hasher = DefaultHasher::new();
        text.hash(&mut hasher);
        if self.sent.0 != hasher.finish() {
            self.sent = (hasher.finish(), now);
            page::mirror(&text);
        }
    }
}

/// Returns the widget tree as JSON, in reading order.
fn tree(update: &TreeUpdate, includes_rects: bool) -> Value {
    let mut nodes: Vec<&(NodeId, Node)> = update.nodes.iter().filter(|(_, node)| has_text(node)).collect();
    // Reading order: rows from the top, each from the left.
    nodes.sort_by(|a, b| reading_position(&a.1).total_cmp(&reading_position(&b.1)).then(a.0.cmp(&b.0)));
    let spoken = update.nodes.iter().find(|(id, _)| *id == update.focus).and_then(|(_, node)| node.label());
    let list: Vec<Value> = nodes.into_iter().map(|(id, node)| entry(*id, node, includes_rects)).collect();
    json!({"nodes": list, "spoken": spoken})
}

/// Whether a visible node has a label or a value. A live region is also needed while it is empty.
fn has_text(node: &Node) -> bool {
    !node.is_hidden() && (node.label().is_some() || node.value().is_some() || node.live().is_some())
}

/// Returns the sort key of a node in reading order: rows of eight points from the top, then from the left.
fn reading_position(node: &Node) -> f64 {
    node.bounds().map_or(0.0, |bounds| (bounds.y0 / 8.0).round() * 1e5 + bounds.x0)
}

/// Returns a node of the widget tree as JSON.
fn entry(id: NodeId, node: &Node, includes_rects: bool) -> Value {
    let checked = node.toggled().map(|toggled| match toggled {
        Toggled::False => "false",
        Toggled::True => "true",
        Toggled::Mixed => "mixed",
    });
    let value =
        node.value().map(str::to_owned).or_else(|| node.numeric_value().map(|value| value.to_string()));
    // The text of a label is also its value; the text is sent only once.
    let (label, value) = if node.role() == Role::Label {
        (node.value().or(node.label()), None)
    } else {
        (node.label(), value)
    };
    let live = node.live().map(|live| match live {
        Live::Off => "off",
        Live::Polite => "polite",
        Live::Assertive => "assertive",
    });
    let bounds = node.bounds().filter(|_| includes_rects);
    let at = bounds.map(|b| format!("{:.1} {:.1} {:.1} {:.1}", b.x0, b.y0, b.x1, b.y1));
    json!({
        "id": id.0.to_string(),
        "role": format!("{:?}", node.role()),
        "label": label,
        "value": value,
        "checked": checked,
        "live": live,
        "description": node.description(),
        "disabled": node.is_disabled(),
        "at": at,
    })
}
