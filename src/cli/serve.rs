//! `smalto serve`: the viewer in browsers.

use std::cell::RefCell;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;

use anyhow::{Context, Result};

use super::devices::{DevicesArgs, first_and_others};
use super::environment::Environment;
use super::headings::{ACCURACY, CAMERAS};
use super::knobs::Knobs;
use super::scenes::ReadingArgs;
use super::view::{self, opaque, options, procedural};
use super::{Usage, complain, knobs, remark, say, values};
use crate::files::describe;
use crate::gpu::Device;
use crate::rules::Background;
use crate::scene::Unreadable;
use crate::serve;
use crate::serve::{Admission, Limits, Proxy, Reopening};
use crate::viewer::{Setup, Start};

/// Show scenes in browsers: the viewer of a machine without a screen
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  smalto serve garden.ply
  smalto serve plush.spz --port 8080 --folder scenes
  smalto serve garden.smalto --host 0.0.0.0 --memory 8GB

docs/serve.md says what the web page shows, and what the server defends against.")]
pub(super) struct Args {
    /// Scene files, folders or procedural scenes, as for `smalto render`
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Port of the server; 0 for a free one
    #[arg(long, help_heading = SERVER, value_name = "PORT", default_value_t = 7007)]
    port: u16,
    /// Address to listen on
    ///
    /// By default only programs of this machine can connect; `ssh -L` makes a browser elsewhere one of them. Beyond
    /// loopback addresses, browsers need the token in the printed address.
    #[arg(long, help_heading = SERVER, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    host: IpAddr,
    /// Ask for a token on loopback addresses, too
    ///
    /// Other users of this machine can connect otherwise.
    #[arg(long, help_heading = SERVER)]
    token: bool,
    /// Address of the web page in browsers that reach it through a proxy
    ///
    /// Like `https://hub.example/user/ann/proxy/7007/` with jupyter-server-proxy of a JupyterHub. The address is
    /// printed with a token, which is always asked for, since others may reach the proxy, too.
    #[arg(long, help_heading = SERVER, value_name = "URL")]
    proxy: Option<Proxy>,
    /// Folder whose scenes, cameras and pictures browsers may open
    #[arg(long, help_heading = SERVER, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Read a scene file again when it changes, and keep the views
    ///
    /// For a training that writes its scene now and then.
    #[arg(long, help_heading = SERVER)]
    follow: bool,
    /// Most browsers at the same time
    #[arg(long, help_heading = SERVER, value_name = "COUNT", default_value_t = 8)]
    #[arg(value_parser = values::whole::<u32>(1..=64))]
    clients: u32,
    /// Camera file [default: found next to the first scene or above it]
    #[arg(long, help_heading = CAMERAS, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    /// Begin at this camera: 7, -1 or an image name [default: first]
    #[arg(long, help_heading = CAMERAS, value_name = "CAMERA", allow_hyphen_values = true)]
    camera: Option<String>,
    /// Folder with the photographs of the cameras, by their names
    ///
    /// By default, a folder `images` beside the camera file or above it.
    #[arg(long, help_heading = CAMERAS, value_name = "DIR")]
    photographs: Option<PathBuf>,
    /// R,G,B (0 to 1), #rrggbb, black, grey or white
    #[arg(long, help_heading = SERVER, value_name = "COLOUR", default_value = "0,0,0", value_parser = opaque)]
    background: Background,
    /// exact, balanced (default), fast, preview, inria, gsplat, khr, portable
    ///
    /// Browsers can change it.
    #[arg(long, help_heading = ACCURACY, value_name = "NAME", value_parser = knobs::preset_names())]
    #[arg(hide_possible_values = true)]
    preset: Option<String>,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    device: DevicesArgs,
}

const SERVER: &str = "Server";

pub(super) fn run(args: &Args) -> Result<()> {
    args.knobs.check_gpu()?;
    let fault = view::fault(&Environment::read()?)?;
    for scene in &args.scenes {
        let is_file = procedural(scene)?.is_none();
        // An address that leads to nothing is not printed.
        if let Some(problem) = std::fs::metadata(scene).err().filter(|_| is_file) {
            return Err(Unreadable::new(scene, &anyhow::anyhow!(describe(&problem))).into());
        }
    }
    if let Some(folder) = args.folder.as_ref().filter(|folder| !folder.is_dir()) {
        return Err(Usage(format!("--folder {}: there is no such folder", folder.display())).into());
    }
    let setup = Setup {
        scenes: args.scenes.clone(),
        reading: args.reading.reading()?,
        reading_options: args.reading.options(),
        cameras: args.cameras.clone(),
        start: args.camera.clone().map(Start::Camera),
        background: args.background,
        photographs: args.photographs.clone(),
        options: options(args.preset.as_deref(), &args.knobs),
        antialiased_is_explicit: args.knobs.has("antialiased"),
        near_is_explicit: args.knobs.has("near"),
        watches_files: args.follow,
        remark,
        ..Setup::default()
    };
    let address = SocketAddr::new(args.host, args.port);
    let listener = TcpListener::bind(address)
        .map_err(|problem| anyhow::anyhow!("cannot listen on {address}: {}", describe(&problem)))?;
    let address = listener.local_addr().context("cannot listen")?;
    let is_local = address.ip().is_loopback();
    let token = (args.token || args.proxy.is_some() || !is_local).then(serve::new_token).transpose()?;
    let (device, other_devices) = first_and_others(args.device.open(usize::MAX)?);
    let setup = Setup { other_devices: other_devices.clone(), ..setup };
    let admission = Admission { is_local, token, folder: args.folder.clone(), proxy: args.proxy.clone() };
    for line in addresses(address, &admission) {
        say!("{line}")?;
    }
    let current = RefCell::new(device.clone());
    let open = |lost: &Device| {
        complain(lost)?;
        let device = args.device.open(1)?.remove(0);
        current.replace(device.clone());
        Ok(device)
    };
    let reopening = Reopening { open: &open, fault };
    let limits = Limits { clients: args.clients as usize };
    serve::serve(listener, (device, reopening), setup, (admission, limits))?;
    other_devices.iter().chain([&*current.borrow()]).try_for_each(complain)
}

/// What a user needs to connect: the address of the web page, and how to reach it from elsewhere.
fn addresses(address: SocketAddr, Admission { token, proxy, .. }: &Admission) -> Vec<String> {
    let fragment = token.as_ref().map_or_else(String::new, |token| format!("#token={token}"));
    let port = address.port();
    let host = match address.ip() {
        ip if ip.is_unspecified() => "THIS_MACHINE".to_owned(),
        IpAddr::V6(ip) => format!("[{ip}]"),
        ip => ip.to_string(),
    };
    let warning = "Pictures and the token are not encrypted: use this in a trusted network only".to_owned();
    if let Some(Proxy { url, .. }) = proxy {
        let handed = format!("The proxy has to hand requests over to http://{host}:{port}/");
        let lines = [format!("{url}{fragment}"), handed].into_iter();
        return lines.chain((!address.ip().is_loopback()).then_some(warning)).collect();
    }
    if address.ip().is_loopback() {
        let host = if address.is_ipv6() { "[::1]" } else { "127.0.0.1" };
        return vec![
            format!("http://localhost:{port}/{fragment}"),
            format!("From another machine: ssh -L {port}:{host}:{port} THIS_MACHINE, then open the same address there"),
        ];
    }
    vec![format!("http://{host}:{port}/{fragment}"), warning]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_can_be_opened() {
        let first = |address: &str, token: Option<&str>| {
            let address: SocketAddr = address.parse().unwrap();
            let token = token.map(str::to_owned);
            let admission = Admission { is_local: address.ip().is_loopback(), token, folder: None, proxy: None };
            addresses(address, &admission).swap_remove(0)
        };
        assert_eq!(first("127.0.0.1:7007", None), "http://localhost:7007/");
        assert_eq!(first("127.0.0.1:7007", Some("ab")), "http://localhost:7007/#token=ab");
        assert_eq!(first("0.0.0.0:80", Some("ab")), "http://THIS_MACHINE:80/#token=ab");
        assert_eq!(first("[fe80::1]:80", Some("ab")), "http://[fe80::1]:80/#token=ab");
    }
}
