//! A server process.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

pub struct Server {
    child: Child,
    pub port: u16,
    /// The token in the printed address.
    pub token: Option<String>,
}

impl Server {
    /// Starts a server of these scenes, with these options, on a free port.
    pub fn start(arguments: &[&str]) -> Self {
        Self::start_at(0, arguments)
    }

    pub fn start_at(port: u16, arguments: &[&str]) -> Self {
        Self::start_with(port, arguments, None, None)
    }

    /// Starts a server that loses its device in this frame of its clients.
    pub fn losing_its_device_in(frame: u32, arguments: &[&str]) -> Self {
        Self::start_with(0, arguments, None, Some(frame))
    }

    /// Starts a server that finds the program `ffmpeg` in a folder.
    pub fn with_ffmpeg(arguments: &[&str], folder: &Path) -> Self {
        let script = "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\nwc -c\n";
        let file = folder.join("ffmpeg");
        std::fs::write(&file, script).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).unwrap();
        Self::start_with(0, arguments, Some(folder), None)
    }

    fn start_with(port: u16, arguments: &[&str], programs: Option<&Path>, loss: Option<u32>) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_smalto"));
        command.arg("serve").args(arguments).args(["--port", &port.to_string()]);
        command.env("SMALTO_VALIDATION", "1").env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"));
        if let Some(frame) = loss {
            command.env("SMALTO_FAULT", format!("device@{frame}"));
        }
        if let Some(folder) = programs {
            command.env("PATH", format!("{}:{}", folder.display(), std::env::var("PATH").unwrap()));
            // The end of a test kills the server, which then leaves its films.
            command.env("TMPDIR", folder);
        }
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the program starts");
        let (mut line, mut second) = (String::new(), String::new());
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        lines.read_line(&mut line).unwrap();
        lines.read_line(&mut second).unwrap();
        let (address, fragment) = line.trim().split_once('/').map_or(("", ""), |_| {
            let rest = line.trim().strip_prefix("http://").expect("the address of a client");
            rest.split_once('/').unwrap()
        });
        // With a proxy, the first address is that of the proxy.
        let own = second.trim().strip_prefix("The proxy has to hand requests over to http://");
        let address = own.map_or(address, |own| own.trim_end_matches('/'));
        let port = address.rsplit_once(':').unwrap().1.parse().unwrap();
        Self { child, port, token: fragment.split_once("#token=").map(|(_, token)| token.to_owned()) }
    }

    pub fn url(&self) -> String {
        let token = self.token.as_ref().map_or_else(String::new, |token| format!("#token={token}"));
        format!("http://localhost:{}/{token}", self.port)
    }

    /// The status and the text of a request with these header lines.
    pub fn request(&self, path: &str, headers: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\n{headers}\r\n").unwrap();
        let mut reader = BufReader::new(stream);
        let mut text = String::new();
        // The server may end the connection at once, and keeps it for a socket.
        while !text.ends_with("\r\n\r\n") && reader.read_line(&mut text).is_ok_and(|bytes| bytes > 0) {}
        let status = text.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        if status != 101 {
            _ = reader.read_to_string(&mut text);
        }
        (status, text)
    }

    /// Resident memory in kB.
    pub fn resident(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").parse().unwrap()
    }

    /// Processor time in clock ticks.
    pub fn ticks(&self) -> u64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap();
        let fields: Vec<_> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
        fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
    }

    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        _ = self.child.kill();
        _ = self.child.wait();
    }
}
