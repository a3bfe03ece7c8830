//! Who may connect: checks of the headers `Host` and `Origin`, of the token, and of paths.

use std::net::IpAddr;
use std::path::{Component, Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use axum::http::Uri;
use subtle::ConstantTimeEq;

/// The rules by which connections are accepted.
#[derive(Clone)]
pub struct Admission {
    /// The server listens on the loopback interface only.
    pub is_local: bool,
    /// Every connection has to show it.
    pub token: Option<String>,
    /// The folder whose files clients may open.
    pub folder: Option<PathBuf>,
    pub proxy: Option<Proxy>,
}

/// A proxy through which browsers reach the server, like that of JupyterHub.
#[derive(Clone, Debug, PartialEq)]
pub struct Proxy {
    /// The address of the web page there. It ends with a slash.
    pub url: String,
    /// The `Origin` that browsers send from there.
    origin: String,
    /// The `Host` that browsers send to the proxy, which may hand it on.
    host: String,
}

impl FromStr for Proxy {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let uri: Uri =
            text.parse().ok().context("expected an address like https://hub.example/user/ann/proxy/7007/")?;
        let scheme = uri.scheme_str().filter(|scheme| ["http", "https"].contains(scheme));
        let scheme = scheme.context("the address of a proxy begins with https:// or http://")?;
        let authority = uri.authority().map_or_else(String::new, |authority| authority.as_str().to_ascii_lowercase());
        let is_plain = !text.contains(['?', '#', '"', '\'']) && !authority.contains('@');
        ensure!(is_plain, "an address without ?, #, @ and quotation marks is expected");
        ensure!(uri.host().is_some_and(|host| !host.is_empty()) && !authority.ends_with(':'), "the host is missing");
        // Browsers leave the usual port out.
        let usual = if scheme == "https" { ":443" } else { ":80" };
        let host = authority.strip_suffix(usual).unwrap_or(&authority).to_owned();
        let origin = format!("{scheme}://{host}");
        Ok(Self { url: format!("{origin}{}/", uri.path().trim_end_matches('/')), origin, host })
    }
}

/// A new token: 128 random bits as hexadecimal digits.
///
/// # Errors
/// If the system gives no random numbers.
pub fn new_token() -> Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).context("the system gives no random numbers")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

impl Admission {
    /// The reason why a request with these headers is refused. Web pages of other sites may not drive a viewer: their
    /// browser sends their address as `Origin`. A site whose name was made to stand for this machine (DNS rebinding)
    /// has that name as `Host`.
    pub fn refuses(&self, host: Option<&str>, origin: Option<&str>) -> Option<&'static str> {
        let Some(host) = host else { return Some("the request has no header Host") };
        // Proxies may leave the port out, or add the usual one.
        let is_of_proxy = |proxy: &Proxy| name_of(host).eq_ignore_ascii_case(name_of(&proxy.host));
        let is_proxied = self.proxy.as_ref().is_some_and(is_of_proxy);
        if self.is_local && !is_proxied && !is_of_this_machine(host) {
            return Some("the server is for this machine, by the names localhost, 127.0.0.1 and [::1]");
        }
        match origin {
            None => None,
            Some(origin) if self.proxy.as_ref().is_some_and(|proxy| proxy.origin == origin) => None,
            // Pages of the proxy by a scheme that is not encrypted are others.
            Some(origin) if !is_proxied && origin.strip_prefix("http://") == Some(host) => None,
            Some(_) => Some("a web page of another address may not connect"),
        }
    }

    /// True if this is the token, or none is asked for. The time does not depend on where a wrong one differs.
    pub fn has_token(&self, given: Option<&str>) -> bool {
        match &self.token {
            None => true,
            Some(token) => token.as_bytes().ct_eq(given.unwrap_or_default().as_bytes()).into(),
        }
    }

    /// The file or folder of a path below the folder of the server.
    ///
    /// # Errors
    /// If clients may open no files, or the path is not below the folder, also by symbolic links.
    pub fn inside(&self, path: &str) -> Result<PathBuf> {
        let folder = self.folder.as_deref().context("this server was started without --folder")?;
        let is_plain = Path::new(path).components().all(|part| matches!(part, Component::Normal(_)));
        ensure!(is_plain, "{path}: the path has to be below the folder of the server");
        let folder = folder.canonicalize().with_context(|| format!("cannot read {}", folder.display()))?;
        let found = folder.join(path).canonicalize().ok().filter(|found| found.starts_with(&folder));
        found.with_context(|| format!("there is no {path} in the folder of the server"))
    }
}

/// The name of a header `Host`, without its port; all of it if it is none.
fn name_of(host: &str) -> &str {
    match host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((name, port)) if port.is_empty() || port.starts_with(':') => name,
        Some(_) => host,
        None => host.split_once(':').map_or(host, |(name, _)| name),
    }
}

/// True if the name of a header `Host` is one of this machine, with any port.
fn is_of_this_machine(host: &str) -> bool {
    let name = name_of(host);
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn admission(is_local: bool) -> Admission {
        Admission { is_local, token: None, folder: None, proxy: None }
    }

    #[test]
    fn other_hosts_and_origins_are_refused() {
        let local = admission(true);
        for host in
            ["localhost", "localhost:7007", "LOCALHOST:80", "127.0.0.1:7007", "[::1]:7007", "[::1]", "127.1.2.3"]
        {
            assert_eq!(local.refuses(Some(host), None), None, "{host}");
            assert_eq!(local.refuses(Some(host), Some(&format!("http://{host}"))), None, "{host}");
            for origin in
                ["http://evil.example", "null", "", "https://localhost:7007", "http://localhost:7007.evil.example"]
            {
                assert!(local.refuses(Some(host), Some(origin)).is_some(), "{host} {origin}");
            }
        }
        for host in
            ["evil.example", "localhost.evil.example:7007", "[::1]evil", "192.168.0.1", "0.0.0.0:7007", "", "[::1"]
        {
            assert!(local.refuses(Some(host), None).is_some(), "{host}");
        }
        assert!(local.refuses(None, None).is_some());
        assert_eq!(admission(false).refuses(Some("render7:7007"), Some("http://render7:7007")), None);
        assert!(admission(false).refuses(Some("render7:7007"), Some("http://evil.example")).is_some());
    }

    #[test]
    fn a_proxy_hands_requests_over() {
        let proxy: Proxy = "https://Hub.Example:443/user/ann/proxy/7007".parse().unwrap();
        assert_eq!(proxy.url, "https://hub.example/user/ann/proxy/7007/");
        assert_eq!("http://hub:8000".parse::<Proxy>().unwrap().url, "http://hub:8000/");
        let proxied = Admission { proxy: Some(proxy), ..admission(true) };
        // Some proxies hand the name of their own over, others that of the server.
        for host in ["hub.example", "HUB.example", "hub.example:443", "localhost:7007", "127.0.0.1:7007"] {
            assert_eq!(proxied.refuses(Some(host), None), None, "{host}");
            assert_eq!(proxied.refuses(Some(host), Some("https://hub.example")), None, "{host}");
            for origin in ["http://hub.example", "https://hub.example:8443", "https://evil.example", "null"] {
                assert!(proxied.refuses(Some(host), Some(origin)).is_some(), "{host} {origin}");
            }
        }
        assert_eq!(proxied.refuses(Some("localhost:7007"), Some("http://localhost:7007")), None);
        assert!(proxied.refuses(Some("evil.example"), Some("https://hub.example")).is_some());
        for wrong in [
            "",
            "hub.example",
            "ftp://hub.example/",
            "https://",
            "https://a/?b",
            "https://a/#b",
            "https://a@b/",
            "https://:443/",
            "https://a:/",
            "https://a/'b",
        ] {
            assert!(wrong.parse::<Proxy>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_token_is_new_and_has_to_be_shown_whole() {
        let token = new_token().unwrap();
        assert!(token.len() == 32 && token != new_token().unwrap());
        let admission = Admission { token: Some(token.clone()), ..admission(false) };
        assert!(admission.has_token(Some(&token)));
        for wrong in [None, Some(""), Some(&token[1..]), Some(&format!("{token}0"))] {
            assert!(!admission.has_token(wrong));
        }
    }

    #[test]
    fn paths_stay_in_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("inside")).unwrap();
        std::fs::create_dir(folder.path().join("open")).unwrap();
        std::fs::write(folder.path().join("secret"), "").unwrap();
        std::fs::write(folder.path().join("open/a.ply"), "").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink("../secret", folder.path().join("open/link")).unwrap();
        let open = Admission { folder: Some(folder.path().join("open")), ..admission(true) };
        assert!(open.inside("a.ply").unwrap().ends_with("a.ply"));
        assert!(open.inside("").unwrap().ends_with("open"));
        for outside in ["../secret", "/etc/passwd", "link", "./a.ply", "inside/../../secret", "missing"] {
            assert!(open.inside(outside).is_err(), "{outside}");
        }
        assert!(admission(true).inside("a.ply").is_err());
    }
}
