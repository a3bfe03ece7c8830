//! The templates in examples/cluster, run as a scheduler runs them.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use saphyr::{LoadableYamlNode, Yaml};

use super::shards::cameras;
use crate::common::program::{ok, path, smalto};

fn template(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/cluster").join(name)
}

/// Runs a program that finds smalto in its PATH, with further variables.
fn launch(program: &str, arguments: &[&str], variables: &[(&str, String)]) -> Output {
    let smalto = Path::new(env!("CARGO_BIN_EXE_smalto")).parent().unwrap();
    let path = format!("{}:{}", smalto.display(), std::env::var("PATH").unwrap());
    let variables = variables.iter().map(|(name, value)| (*name, value.as_str()));
    Command::new(program).args(arguments).env("PATH", path).envs(variables).output().unwrap()
}

fn succeeds(output: &Output) {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn tasks_of_the_slurm_array_draw_all_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 10), path(&folder, "my views"));
    let script = template("slurm.sh").display().to_string();
    let text = std::fs::read_to_string(&script).unwrap();
    assert!(text.contains("#SBATCH --array=1-8\n") && text.contains("${SHARDS:-8}"), "as many shards as tasks");
    let task = |number: usize| {
        let variables = [("SLURM_ARRAY_TASK_ID", number.to_string())];
        launch("bash", &[&script, "cactus:100", &file, &out], &variables)
    };
    let verify = ["render", "cactus:100", "--cameras", &file, "--camera", "all", "-o", &out, "--verify"];
    (1..8).for_each(|number| succeeds(&task(number)));
    assert_eq!(smalto(&verify).status.code(), Some(6), "a task is missing");
    (7..=8).for_each(|number| succeeds(&task(number)));
    assert_eq!(ok(&verify), "all 10 files are complete\n");
}

#[test]
fn pods_of_the_kubernetes_job_draw_all_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 9), path(&folder, "views"));
    let text = std::fs::read_to_string(template("kubernetes.yaml")).unwrap();
    let job = &Yaml::load_from_str(&text).unwrap()[0];
    let spec = &job["spec"];
    assert_eq!([&job["apiVersion"], &job["kind"]].map(|text| text.as_str().unwrap()), ["batch/v1", "Job"]);
    assert_eq!(spec["completionMode"].as_str(), Some("Indexed"));
    let container = &spec["template"]["spec"]["containers"][0];
    let shards = container["env"][0]["value"].as_str().unwrap();
    assert_eq!(container["env"][0]["name"].as_str(), Some("SHARDS"));
    assert_eq!(spec["completions"].as_integer().unwrap().to_string(), shards);

    let words = |list: &Yaml| list.as_sequence().unwrap().iter().map(|w| w.as_str().unwrap().to_owned()).collect();
    let [command, mut arguments]: [Vec<String>; 2] = [&container["command"], &container["args"]].map(words);
    let count = arguments.len();
    arguments.splice(count - 3.., ["cactus:100".to_owned(), file.clone(), out.clone()]);
    let all: Vec<&str> = command[1..].iter().chain(&arguments).map(String::as_str).collect();
    for index in 0..shards.parse().unwrap() {
        let variables = [("JOB_COMPLETION_INDEX", format!("{index}")), ("SHARDS", shards.to_owned())];
        succeeds(&launch(&command[0], &all, &variables));
    }
    let verify = ["render", "cactus:100", "--cameras", &file, "--camera", "all", "-o", &out, "--verify"];
    assert_eq!(ok(&verify), "all 9 files are complete\n");
}

#[test]
#[ignore = "needs Ray: SMALTO_RAY_PYTHON, a Python that has it"]
fn tasks_of_ray_draw_all_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 9), path(&folder, "views"));
    let python = std::env::var("SMALTO_RAY_PYTHON").expect("SMALTO_RAY_PYTHON is set");
    let script = template("ray_shards.py").display().to_string();
    succeeds(&launch(&python, &[&script, "cactus:100", &file, &out, "4", "0"], &[]));
    let verify = ["render", "cactus:100", "--cameras", &file, "--camera", "all", "-o", &out, "--verify"];
    assert_eq!(ok(&verify), "all 9 files are complete\n");
}
