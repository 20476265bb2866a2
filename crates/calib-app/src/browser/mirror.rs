//! Widget tree as invisible HTML, for screen readers and tests.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::time::Duration;

use egui::accesskit::{Node, NodeId, Role, Toggled, TreeUpdate};
use egui::{Context, FullOutput, Plugin};
use serde_json::{Value, json};

use crate::platform::web::page;

/// Shortest interval between two updates, in seconds.
const PACE: f64 = 0.1;

/// Sends changes of the tree to the page.
#[derive(Debug, Default)]
pub(crate) struct Mirror {
    /// Hash of the last update, and its time.
    sent: (u64, f64),
    /// Whether each node contains its rectangle.
    tells_places: bool,
}

impl Mirror {
    /// Creates a mirror; tests need the rectangles of widgets.
    pub(crate) fn new(tells_places: bool) -> Self {
        Self { tells_places, ..Self::default() }
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
        let rest = PACE - (now - self.sent.1);
        if rest > 0.0 {
            ctx.request_repaint_after(Duration::from_secs_f64(rest));
            return;
        }
        let text = tree(&update, self.tells_places).to_string();
        let mut hasher = DefaultHasher::new();
        text.hash(&mut hasher);
        if self.sent.0 != hasher.finish() {
            self.sent = (hasher.finish(), now);
            page::mirror(&text);
        }
    }
}

fn tree(update: &TreeUpdate, tells_places: bool) -> Value {
    let mut nodes: Vec<&(NodeId, Node)> =
        update.nodes.iter().filter(|(_, node)| says_something(node)).collect();
    // Reading order: rows from the top, each from the left.
    nodes.sort_by(|a, b| place(&a.1).total_cmp(&place(&b.1)).then(a.0.cmp(&b.0)));
    let spoken = update.nodes.iter().find(|(id, _)| *id == update.focus).and_then(|(_, node)| node.label());
    let list: Vec<Value> = nodes.into_iter().map(|(id, node)| entry(*id, node, tells_places)).collect();
    json!({"nodes": list, "spoken": spoken})
}

fn says_something(node: &Node) -> bool {
    !node.is_hidden() && (node.label().is_some() || node.value().is_some())
}

/// Sort key: rows of eight points, then columns.
fn place(node: &Node) -> f64 {
    node.bounds().map_or(0.0, |bounds| (bounds.y0 / 8.0).round() * 1e5 + bounds.x0)
}

fn entry(id: NodeId, node: &Node, tells_places: bool) -> Value {
    let checked = node.toggled().map(|toggled| match toggled {
        Toggled::False => "false",
        Toggled::True => "true",
        Toggled::Mixed => "mixed",
    });
    let value =
        node.value().map(str::to_owned).or_else(|| node.numeric_value().map(|value| value.to_string()));
    // The text of a label is its value; it is sent once.
    let (label, value) = if node.role() == Role::Label {
        (node.value().or(node.label()), None)
    } else {
        (node.label(), value)
    };
    let bounds = node.bounds().filter(|_| tells_places);
    let at = bounds.map(|b| format!("{:.1} {:.1} {:.1} {:.1}", b.x0, b.y0, b.x1, b.y1));
    json!({
        "id": id.0.to_string(),
        "role": format!("{:?}", node.role()),
        "label": label,
        "value": value,
        "checked": checked,
        "disabled": node.is_disabled(),
        "at": at,
    })
}
