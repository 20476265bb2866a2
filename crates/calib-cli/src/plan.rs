//! `calib plan`: prints size, scale, pages and layers of a floor plan, or writes the plan as an image or into a
//! site.

use std::fmt::Write as _;
use std::path::Path;

use calib_core::PlanPixel;
use calib_plan::{Drawing, DrawingFacts, DrawingKind, ScaleSource, View};
use calib_report::{added_walls_text, shortened_list};
use calib_site::{MapPosition, Plan, Site, WallEntry};
use serde_json::{Value, json};

use crate::args::unit;
use crate::files::{self, print_message};
use crate::map_position::{MapUnits, PlanFile, map_units};
use crate::picture;
use crate::site_file::{SiteFile, path_relative_to_file};
use crate::solve::Format;
use crate::stop::{CommandError, escape_control_characters};

/// Arguments that choose the shown part and the scale of a floor plan.
#[derive(Debug, clap::Args)]
pub(crate) struct DrawingArgs {
    /// Page of a PDF, from 1
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    page: Option<u32>,
    /// Layer of a DXF to show; repeat for several [default: the layers that are on in the drawing]
    #[arg(long = "layer", value_name = "NAME")]
    layers: Vec<String>,
    /// Scale of a PDF, such as 1:100
    #[arg(long, value_name = "1:N", value_parser = ratio, conflicts_with = "unit")]
    scale: Option<f64>,
    /// Unit of a DXF: mm, cm, m, in or ft
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    unit: Option<f64>,
    /// Size of a pixel in metres, for plans that state no scale
    #[arg(long, value_name = "M", value_parser = pixel_size, conflicts_with_all = ["scale", "unit"])]
    metres_per_px: Option<f64>,
}

/// An option of [`DrawingArgs`]: name, whether it is given, and the type and name of the format that it needs.
type DrawingOption = (&'static str, bool, Option<(DrawingKind, &'static str)>);

impl DrawingArgs {
    /// Returns the chosen layers; `None` for the layers that are on in the drawing.
    fn layers(&self) -> Option<Vec<String>> {
        (!self.layers.is_empty()).then(|| self.layers.clone())
    }

    /// Returns the options.
    fn options(&self) -> [DrawingOption; 5] {
        let (pdf, dxf) = (Some((DrawingKind::Pdf, "PDF")), Some((DrawingKind::Dxf, "DXF")));
        [
            ("--page", self.page.is_some(), pdf),
            ("--scale", self.scale.is_some(), pdf),
            ("--layer", !self.layers.is_empty(), dxf),
            ("--unit", self.unit.is_some(), dxf),
            ("--metres-per-px", self.metres_per_px.is_some(), None),
        ]
    }

    /// Returns the name of an option that is given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        self.options().into_iter().find(|(_, is_given, _)| *is_given).map(|(name, ..)| name)
    }
}

/// Arguments of `calib plan`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Floor plan: PDF, DXF, SVG, an image (such as PNG or TIFF, also with a world file), or a ground overlay (KML)
    file: String,
    #[command(flatten)]
    drawing: DrawingArgs,
    /// Grid of a map image without grid information, such as EPSG:25832; EPSG:4326 for degrees
    #[arg(long, value_name = "EPSG:CODE", value_parser = map_units)]
    crs: Option<MapUnits>,
    /// Site to write this plan into; its cameras keep their positions
    #[arg(long, value_name = "SITE", requires = "output")]
    site: Option<String>,
    /// Layer of a DXF whose straight lines become walls of the site, for the coverage; repeat for several
    #[arg(long, value_name = "LAYER", requires = "site")]
    walls: Vec<String>,
    /// Height of the walls of --walls, in metres [default: higher than every camera]
    #[arg(long, value_name = "M", value_parser = wall_height, requires = "walls")]
    wall_height_m: Option<f64>,
    /// File to write: an image (PNG, or JPEG for .jpg), or with --site the site with this plan; - is stdout
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
    /// Output format [default: text on a terminal, otherwise json]
    #[arg(long, value_enum)]
    format: Option<Format>,
}

/// Parses a scale such as 1:100 or 100.
fn ratio(text: &str) -> Result<f64, String> {
    let number = text.strip_prefix("1:").unwrap_or(text).trim().parse::<f64>();
    number
        .ok()
        .filter(|ratio| (1e-3..=1e6).contains(ratio))
        .ok_or_else(|| "expected a scale such as 1:100".into())
}

/// Parses the size of a pixel in metres.
fn pixel_size(text: &str) -> Result<f64, String> {
    let size = text.trim().parse::<f64>().ok().filter(|size| (1e-9..1e9).contains(size));
    size.ok_or_else(|| "expected a number of metres above 0".into())
}

/// Parses the height of a wall in metres.
fn wall_height(text: &str) -> Result<f64, String> {
    let height = text.trim().parse::<f64>().ok().filter(|height| (0.01..=1e3).contains(height));
    height.ok_or_else(|| "expected a number of metres from 0.01 to 1000".into())
}

/// Floor plan that was read.
struct ReadPlan {
    drawing: Option<Drawing>,
    size: [u32; 2],
    image: Option<image::RgbImage>,
    /// Size of a pixel in metres, and the source of this scale.
    scale: Option<(f64, String)>,
    /// Position of the plan on the map, if its files contain one.
    position: Option<MapPosition>,
}

/// Reads the plan. Prints its properties, or writes it as an image or into a site.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
        if args.site.is_none()
            && let Err(CommandError::Usage(problem)) = picture::is_jpeg_name(output)
        {
            return Err(CommandError::Usage(format!(
                "{problem}; add --site SITE to write a site with this plan"
            )));
        }
    }
    let file = PlanFile::read(&args.file)?;
    let path = file.path.as_path();
    let site = args.site.as_ref().map(|site| SiteFile::read(site)).transpose()?;
    let of_site = || site.as_ref()?.site.coordinate_system().map(|grid| MapUnits::Grid(Box::new(grid)));
    let crs = args.crs.clone().or_else(of_site);
    let read = read_plan(&file, &args.file, &args.drawing, crs.as_ref())?;
    if let Some((site, name)) = site.zip(args.site.as_ref()) {
        let walls = wall_lines(args, &file.bytes)?;
        return write_site(args, (site, name, path), &read, &walls);
    }
    if let Some(output) = &args.output {
        let invalid = |error| CommandError::invalid(path.display(), error);
        let image = read.into_image().map_err(invalid)?;
        return files::write(output, &picture::encode(&image, output)?, args.force);
    }
    let format = Format::given_or_usual(args.format);
    files::print(&match format {
        Format::Json => format!("{}\n", as_json(args, path, &read)?),
        Format::Text => escape_control_characters(&as_text(args, &read)).into_owned(),
    })
}

impl ReadPlan {
    /// Returns the image of the plan.
    fn into_image(self) -> Result<image::RgbImage, String> {
        match (self.image, self.drawing) {
            (Some(image), _) => Ok(image),
            (None, Some(drawing)) => drawing.into_image().map_err(|error| error.to_string()),
            (None, None) => Err("has no pixels".into()),
        }
    }
}

/// Reads a plan for a new site. Returns its entry, with an image path relative to the file `output`, and its image.
pub(crate) fn read_entry(
    name: &str,
    args: &DrawingArgs,
    output: &str,
) -> Result<(Plan, image::RgbImage), CommandError> {
    let file = PlanFile::read(name)?;
    let read = read_plan(&file, name, args, None)?;
    let image = path_relative_to_file(&file.path, output);
    let plan = match (&read.position, &read.scale) {
        (Some(position), _) => on_map(&Site::new(), image, &read, position, name)?,
        (None, Some((metres_per_px, _))) => entry(image, &read, args, *metres_per_px),
        (None, None) => return Err(CommandError::Usage(unknown_scale(&read))),
    };
    Ok((plan, read.into_image().map_err(|error| CommandError::invalid(name, error))?))
}

fn read_plan(
    file: &PlanFile,
    name: &str,
    args: &DrawingArgs,
    crs: Option<&MapUnits>,
) -> Result<ReadPlan, CommandError> {
    let bytes = &file.bytes;
    let invalid = |error: String| CommandError::invalid(name, error);
    let view = &View { page: args.page, layers: args.layers() };
    let given = args.metres_per_px.map(|size| (size, "from --metres-per-px".to_owned()));
    let drawing = calib_plan::read(bytes, view).transpose().map_err(|error| invalid(error.to_string()))?;
    let kind = drawing.as_ref().map(|drawing| drawing.facts.kind);
    for (option, is_given, needed) in args.options() {
        if let Some((_, format)) = needed.filter(|(needed, _)| is_given && kind != Some(*needed)) {
            return Err(CommandError::Usage(format!("{option}: {name} is not a {format} file")));
        }
    }
    let Some(drawing) = drawing else {
        let image = calib_input::decode(bytes).map_err(|error| invalid(error.to_string()))?;
        let size = image.dimensions().into();
        let position = if given.is_some() { None } else { file.position((size, 1), crs)? };
        return Ok(ReadPlan { drawing: None, size, image: Some(image), scale: given, position });
    };
    let facts = &drawing.facts;
    check_layers("--layer", &args.layers, facts, name)?;
    for note in &facts.notes {
        print_message(format_args!("calib: {name}: {note}"));
    }
    let by_option = match (args.scale.zip(facts.paper_metres_per_px), args.unit.zip(facts.units_per_px)) {
        (Some((scale, paper)), _) => Some((paper * scale, format!("1:{scale}, from --scale"))),
        (_, Some((unit, units_per_px))) => Some((units_per_px * unit, "from --unit".into())),
        (None, None) => None,
    };
    let own = || {
        let source = match facts.scale_source? {
            ScaleSource::Unit => "from the unit of the drawing".into(),
            ScaleSource::Text(ratio) => {
                format!("1:{ratio}, from text on the page; check the scale with a known distance")
            }
        };
        Some((facts.metres_per_px?, source))
    };
    let scale = given.or(by_option).or_else(own);
    let position = if scale.is_some() { None } else { file.position((facts.size, facts.reduction), crs)? };
    Ok(ReadPlan { size: facts.size, scale, drawing: Some(drawing), image: None, position })
}

/// Returns the plan entry of a site, for a plan with a known scale and without a position on the map.
fn entry(image: String, read: &ReadPlan, args: &DrawingArgs, metres_per_px: f64) -> Plan {
    let height = f64::from(read.size[1]);
    let [x, y] = read.drawing.as_ref().map_or([0.0, height], |drawing| drawing.facts.world_origin_px());
    Plan {
        image: Some(image),
        page: args.page,
        layers: args.layers(),
        metres_per_px,
        origin_px: PlanPixel::new(x, y),
        x_axis_deg: 0.0,
        georeference: None,
    }
}

/// Source of the scale of a georeferenced image.
const MAP_SCALE: &str = "from the position of the image on the map";

/// Returns the plan entry of a georeferenced image.
fn on_map(
    site: &Site,
    image: String,
    read: &ReadPlan,
    position: &MapPosition,
    name: &str,
) -> Result<Plan, CommandError> {
    site.plan_on_map(Some(image), read.size, position).map_err(|error| CommandError::invalid(name, error))
}

/// Writes the site with this plan.
fn write_site(
    args: &Args,
    (file, site, path): (SiteFile, &str, &Path),
    read: &ReadPlan,
    walls: &WallLines,
) -> Result<(), CommandError> {
    let output = args.output.as_deref().unwrap_or("-");
    let file = file.relative_to(output);
    // On stdout, all paths stay relative to the folder of the site.
    let image = path_relative_to_file(path, if output == "-" { site } else { output });
    let (plan, source) = match (&read.position, &read.scale) {
        (Some(position), _) => (on_map(&file.site, image, read, position, &args.file)?, MAP_SCALE),
        (None, Some((metres_per_px, source))) => {
            (entry(image, read, &args.drawing, *metres_per_px), source.as_str())
        }
        (None, None) => return Err(CommandError::Usage(unknown_scale(read))),
    };
    print_message(format_args!(
        "calib: {} m per pixel ({source}); world (0, 0) is at plan pixel {}, {}; cameras and control points \
         keep their positions in metres",
        plan.metres_per_px, plan.origin_px.x, plan.origin_px.y
    ));
    let mut site = file.site;
    let entries: Vec<WallEntry> = walls
        .lines
        .iter()
        .map(|line| line.map(|end| plan.scale().floor_from_plan(end)))
        .map(|[from_m, to_m]| WallEntry { from_m, to_m, height_m: args.wall_height_m })
        .collect();
    site.replace_plan(plan);
    let [added, short] = site.add_walls(entries);
    if !args.walls.is_empty() {
        let text = added_walls_text(&args.walls.join(", "), added, walls.others, short);
        print_message(format_args!("calib: {text}"));
    }
    site.check().map_err(|error| {
        let advice = if added > 0 { "; choose a layer with fewer lines" } else { "" };
        CommandError::invalid(&args.file, format!("the site is not valid with this plan: {error}{advice}"))
    })?;
    files::write(output, site.to_json().as_bytes(), args.force)
}

/// Lines of the layers that become walls.
#[derive(Default)]
struct WallLines {
    /// Both ends of the straight lines, in plan pixels.
    lines: Vec<[PlanPixel; 2]>,
    /// Number of the other lines of the layers, such as arcs. They do not become walls.
    others: usize,
}

/// Returns the lines of the layers that become walls.
fn wall_lines(args: &Args, bytes: &[u8]) -> Result<WallLines, CommandError> {
    if args.walls.is_empty() {
        return Ok(WallLines::default());
    }
    let view = View { page: None, layers: Some(args.walls.clone()) };
    let invalid = |error: String| CommandError::invalid(&args.file, error);
    let drawing = calib_plan::read(bytes, &view).transpose().map_err(|error| invalid(error.to_string()))?;
    let Some(drawing) = drawing.filter(|drawing| drawing.facts.kind == DrawingKind::Dxf) else {
        return Err(CommandError::Usage(format!("--walls: {} is not a DXF file", args.file)));
    };
    check_layers("--walls", &args.walls, &drawing.facts, &args.file)?;
    // The pixels of a drawing do not depend on the layers that are shown.
    let layers = &drawing.facts.layers;
    let lines = layers.iter().flat_map(|layer| &layer.lines_px);
    let lines = lines.map(|line| line.map(|end| PlanPixel::from(end.map(f64::from)))).collect();
    Ok(WallLines { lines, others: layers.iter().map(|layer| layer.other_lines).sum() })
}

/// Refuses names that are not layers of the drawing.
fn check_layers(
    option: &str,
    asked: &[String],
    facts: &DrawingFacts,
    file: &str,
) -> Result<(), CommandError> {
    match asked.iter().find(|name| !facts.has_layer(name)) {
        None => Ok(()),
        Some(unknown) => {
            let names = shortened_list(facts.layers.iter().map(|layer| layer.name.as_str()));
            Err(CommandError::Usage(format!("{option} {unknown}: no such layer; layers in {file}: {names}")))
        }
    }
}

/// Returns the advice for a plan without a scale.
fn unknown_scale(read: &ReadPlan) -> String {
    match read.drawing.as_ref().map(|drawing| &drawing.facts) {
        Some(DrawingFacts { kind: DrawingKind::Pdf, scales_in_text, .. }) if !scales_in_text.is_empty() => {
            let scales: Vec<String> = scales_in_text.iter().map(|one| format!("1:{one}")).collect();
            format!("--scale is missing; choose from the scales on the page: {}", scales.join(", "))
        }
        Some(DrawingFacts { kind: DrawingKind::Pdf, .. }) => {
            "--scale is missing: the page contains no scale; give one, such as 1:100".into()
        }
        Some(DrawingFacts { kind: DrawingKind::Dxf, .. }) => {
            "--unit is missing: the drawing states no unit of length; give one, such as mm".into()
        }
        _ => "--metres-per-px is missing: the file states no scale; measure the scale in the app".into(),
    }
}

fn as_json(args: &Args, path: &Path, read: &ReadPlan) -> Result<Value, CommandError> {
    let drawing = read.drawing.as_ref();
    let kind = drawing.map_or("image", |drawing| name(drawing.facts.kind));
    let shown: Vec<Value> = drawing.map_or_else(Vec::new, |drawing| {
        let layer = |layer: &calib_plan::Layer| {
            json!({"name": layer.name, "shown": layer.is_shown, "count": layer.count})
        };
        drawing.facts.layers.iter().map(layer).collect()
    });
    let image = path.to_string_lossy().into_owned();
    let (plan, source) = match (&read.position, &read.scale) {
        (Some(position), _) => {
            (Some(on_map(&Site::new(), image, read, position, &args.file)?), Some(MAP_SCALE))
        }
        (None, Some((scale, source))) => {
            (Some(entry(image, read, &args.drawing, *scale)), Some(source.as_str()))
        }
        (None, None) => (None, None),
    };
    Ok(json!({
        "kind": kind,
        "size_px": read.size,
        "pages": drawing.map_or(1, |drawing| drawing.facts.pages),
        "layers": shown,
        "metres_per_px": plan.as_ref().map(|plan| plan.metres_per_px),
        "scale_source": source,
        "scales_in_text": drawing.map_or_else(Vec::new, |drawing| drawing.facts.scales_in_text.clone()),
        "notes": drawing.map_or_else(Vec::new, |drawing| drawing.facts.notes.clone()),
        "plan": plan,
    }))
}

fn name(kind: DrawingKind) -> &'static str {
    match kind {
        DrawingKind::LargeTiff => "large TIFF",
        DrawingKind::Svg => "svg",
        DrawingKind::Pdf => "pdf",
        DrawingKind::Dxf => "dxf",
        DrawingKind::Dwg => "dwg",
    }
}

fn as_text(args: &Args, read: &ReadPlan) -> String {
    let [width, height] = read.size;
    let kind = read.drawing.as_ref().map_or("image", |drawing| name(drawing.facts.kind));
    let mut text = format!("{}: {kind}, {width} x {height} pixels\n", args.file);
    let on_map = read.position.as_ref().and_then(|position| {
        let plan = Site::new().plan_on_map(None, read.size, position);
        plan.map_err(|error| text += &format!("Position: unusable, because {error}\n")).ok()
    });
    let of_map = on_map.as_ref().map(|plan| (plan.metres_per_px, MAP_SCALE.to_owned()));
    if let Some(corner) = on_map.as_ref().and_then(|plan| plan.georeference.as_ref()) {
        let _ = writeln!(
            text,
            "Position: lower left corner at latitude {:.7}\u{b0}, longitude {:.7}\u{b0}; the bottom edge runs \
             {:.2}\u{b0} clockwise from north",
            corner.lat_deg, corner.lon_deg, corner.x_axis_azimuth_deg
        );
    }
    match of_map.as_ref().or(read.scale.as_ref()) {
        Some((scale, source)) => {
            let [w, h] = read.size.map(|side| f64::from(side) * scale);
            let _ =
                writeln!(text, "Scale: {scale} m per pixel ({source}); the plan shows {w:.2} m x {h:.2} m");
        }
        None => {
            let _ = writeln!(text, "Scale: unknown. {}", unknown_scale(read));
        }
    }
    if let Some(drawing) = &read.drawing {
        if drawing.facts.pages > 1 {
            let _ = writeln!(text, "Page: {} of {}", args.drawing.page.unwrap_or(1), drawing.facts.pages);
        }
        for (is_shown, title) in [(true, "Shown layers"), (false, "Hidden layers")] {
            let layers =
                drawing.facts.layers.iter().filter(|layer| layer.is_shown == is_shown && layer.count > 0);
            let names: Vec<&str> = layers.map(|layer| layer.name.as_str()).collect();
            if !names.is_empty() {
                let _ = writeln!(text, "{title}: {}", shortened_list(names.into_iter()));
            }
        }
    }
    text
}
