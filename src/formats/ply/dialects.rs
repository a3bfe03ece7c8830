//! Properties and elements that trainers and tools write beside those of the original 3DGS, and what is missing in the
//! picture without them. Unknown ones are named in a note.

use super::header::Element;

/// Properties that are read. `#` stands for a number.
const USED: [&str; 10] = ["x", "y", "z", "f_dc_#", "f_rest_#", "opacity", "scale_#", "rot_#", "filter_3D", "packed_*"];

/// Beginnings of names that only properties of Gaussians have. A PLY with one of them is no point cloud.
const HINTS: [&str; 12] = [
    "f_dc_",
    "f_rest_",
    "opacity",
    "scale_",
    "rot_",
    "filter_3D",
    "f_anchor_feat_",
    "f_offset_",
    "trbf_",
    "sh0_",
    "shN_",
    "sb_params_",
];

/// Properties that are not read, by their writers.
struct Dialect {
    /// Names that this writer alone gives; `#` at the end stands for a number, `*` for any text.
    names: &'static [&'static str],
    /// What the picture lacks; `None` if it does not depend on them.
    lacks: Option<&'static str>,
}

const fn harmless(names: &'static [&'static str]) -> Dialect {
    Dialect { names, lacks: None }
}

const fn lacking(names: &'static [&'static str], lacks: &'static str) -> Dialect {
    Dialect { names, lacks: Some(lacks) }
}

const DIALECTS: [Dialect; 16] = [
    // The original and most trainers write normals of 0; mesh2splat writes octahedral ones.
    harmless(&["nx", "ny", "nz", "normal_*", "octa_nx", "octa_ny"]),
    // Colours for viewers of point clouds, beside the coefficients or instead of them.
    harmless(&["red", "green", "blue", "alpha", "r", "g", "b", "a", "diffuse_*"]),
    // Features for segmentation and search: Gaussian Grouping, Feature 3DGS, OpenGaussian, SADG.
    harmless(&["obj_dc_#", "semantic_*", "ins_feat_*", "gaussian_features_#", "language_feature_#"]),
    harmless(&["label", "class", "classification", "segment", "instance", "object_id", "cluster", "id"]),
    // Statistics of trainers, scanners and editors of point clouds.
    harmless(&["confidence", "max_radii2D", "importance", "intensity", "Intensity", "quality", "curvature"]),
    harmless(&["s", "t", "u", "v", "gps_time", "GpsTime", "transform", "Original_cloud_index"]),
    lacking(&["state"], "the marks of SuperSplat: Gaussians that it hides or deletes are drawn"),
    lacking(
        &["trbf_center", "trbf_scale", "motion_#", "omega_#", "f_t_#"],
        "the motion and fading of Spacetime Gaussians: those of all times are drawn at once, unmoved",
    ),
    lacking(
        &["scale_3", "scaling_t", "scale_t", "rot_4", "rot_5", "rot_6", "rot_7", "rot_r_#", "velocity_*"],
        "the time axis of 4D Gaussians: those of all times are drawn at once",
    ),
    lacking(
        &["f_anchor_feat_#", "f_offset_#"],
        "the network of Scaffold-GS, which makes the Gaussians from these anchors",
    ),
    lacking(&["binding_#"], "the mesh of GaussianAvatars, to whose triangles the Gaussians are bound"),
    lacking(
        &["sh0_#", "shN_#", "sb_params_#"],
        "the Beta kernels and lobes of Deformable Beta Splatting, which are no Gaussians",
    ),
    lacking(&["negative"], "the kernels of Student Splatting and Scooping, some of them negative"),
    lacking(
        &["f_asg_#", "sg_axis_#", "sg_sharpness_#", "sg_color_#"],
        "highlights by spherical Gaussians (Spec-Gaussian, SG-Splatting)",
    ),
    lacking(
        &["base_color_#", "albedo_*", "roughness*", "metallic*", "specular_#", "incidents_*", "visibility_*"],
        "materials and incident light for relighting",
    ),
    lacking(&["appearance_*", "embedding_#"], "appearances by photograph"),
];

/// Elements that do not change the picture: meshes and cameras, and what SHARP records of its photograph.
const HARMLESS_ELEMENTS: [&str; 14] = [
    "vertex",
    "chunk",
    "sh",
    "face",
    "edge",
    "tristrips",
    "camera",
    "extrinsic",
    "intrinsic",
    "image_size",
    "frame",
    "disparity",
    "color_space",
    "version",
];

/// The first property that only Gaussians have.
pub(crate) fn hint(element: &Element) -> Option<&str> {
    let is_hint = |name: &&str| HINTS.iter().any(|hint| name.starts_with(hint));
    element.properties.iter().map(|p| p.name.as_str()).find(is_hint)
}

/// What Gaussians with these properties need and smalto lacks, as a clause.
pub(crate) fn foreign(element: &Element) -> Option<String> {
    let lacks = DIALECTS.iter().filter(|dialect| !dialect.of(element).is_empty()).find_map(|dialect| dialect.lacks)?;
    Some(format!("smalto does not have {lacks}"))
}

/// Notes on properties that change the picture or are unknown, and are not used.
pub(crate) fn notices(element: &Element) -> Vec<String> {
    let mut notices = Vec::new();
    for dialect in &DIALECTS {
        let names = dialect.of(element);
        if let (Some(lacks), false) = (dialect.lacks, names.is_empty()) {
            notices.push(format!("{} not used, so the picture lacks {lacks}", are(&names)));
        }
    }
    let is_unknown =
        |name: &&str| !USED.iter().any(|known| fits(known, name)) && !DIALECTS.iter().any(|dialect| dialect.has(name));
    let unknown: Vec<&str> = element.properties.iter().map(|p| p.name.as_str()).filter(is_unknown).collect();
    if !unknown.is_empty() {
        notices.push(format!("{} unknown and not used", are(&unknown)));
    }
    notices
}

/// A note on elements that hold something unknown.
pub(crate) fn element_notice(elements: &[Element]) -> Option<String> {
    let is_unknown = |element: &&Element| element.count > 0 && !HARMLESS_ELEMENTS.contains(&element.name.as_str());
    let unknown: Vec<String> = elements.iter().filter(is_unknown).map(|element| element.name.clone()).collect();
    let are = if unknown.len() == 1 { "element" } else { "elements" };
    (!unknown.is_empty()).then(|| format!("it has the unknown {are} {}, not used", listed(&unknown)))
}

impl Dialect {
    fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| fits(known, name))
    }

    /// The properties of an element in this dialect.
    fn of<'e>(&self, element: &'e Element) -> Vec<&'e str> {
        element.properties.iter().map(|p| p.name.as_str()).filter(|name| self.has(name)).collect()
    }
}

fn fits(known: &str, name: &str) -> bool {
    if let Some(stem) = known.strip_suffix('*') {
        return name.starts_with(stem);
    }
    match known.strip_suffix('#') {
        Some(stem) => number(name).is_some_and(|(of, _)| of == stem),
        None => known == name,
    }
}

/// A name as its stem and the number at its end.
fn number(name: &str) -> Option<(&str, &str)> {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    (stem.len() < name.len()).then(|| name.split_at(stem.len()))
}

/// The names with their verb: "the properties a_0 to a_31 and b are". Numbered names are joined.
fn are(names: &[&str]) -> String {
    let mut groups: Vec<(&str, &str, &str)> = Vec::new();
    for name in names {
        let stem = number(name).map_or(*name, |(stem, _)| stem);
        match groups.last_mut() {
            Some((of, _, last)) if *of == stem => *last = name,
            _ => groups.push((stem, name, name)),
        }
    }
    let texts: Vec<String> = groups
        .iter()
        .map(|(_, first, last)| if first == last { (*first).to_owned() } else { format!("{first} to {last}") })
        .collect();
    match names {
        [name] => format!("the property {name} is"),
        _ => format!("the properties {} are", listed(&texts)),
    }
}

/// Texts as a list: "a, b and c", of which at most six are named.
fn listed(texts: &[String]) -> String {
    const MOST: usize = 6;
    let more = texts.len().saturating_sub(MOST);
    let mut named: Vec<String> = texts.iter().take(MOST).cloned().collect();
    if more > 0 {
        named.push(format!("{more} more"));
    }
    match named.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => named.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_names_are_joined() {
        assert_eq!(are(&["a_0", "a_1", "a_2", "b"]), "the properties a_0 to a_2 and b are");
        assert_eq!(are(&["a_0"]), "the property a_0 is");
        let many: Vec<String> = (0..9).map(|i| format!("{}{i}", char::from(b'a' + i))).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        assert_eq!(are(&many), "the properties a0, b1, c2, d3, e4, f5 and 3 more are");
    }

    #[test]
    fn names_fit_their_patterns() {
        assert!(fits("f_rest_#", "f_rest_44") && !fits("f_rest_#", "f_rest_") && !fits("f_rest_#", "f_rest_x"));
        assert!(fits("metallic*", "metallicFactor") && !fits("beta", "beta_0"));
    }
}
