#!/usr/bin/env bash
# Builds the program and makes target/dist/smalto-VERSION-ARCH-linux.tar.gz: `cp -r bin share ~/.local/` installs it.
set -euo pipefail
cd "$(dirname "$0")/.."

version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)
name=smalto-$version-$(uname -m)-linux
dist=target/dist
folder=$dist/$name
share=$folder/share

cargo build --release --locked --bin smalto
rm -rf "$folder"
mkdir -p "$folder/bin" "$share/man" "$share/doc/smalto/docs" "$share/applications" "$share/icons/hicolor/scalable/apps" \
    "$share/bash-completion/completions" "$share/zsh/site-functions" "$share/fish/vendor_completions.d"

install -m 755 target/release/smalto "$folder/bin/smalto"
strip "$folder/bin/smalto"
smalto=$folder/bin/smalto

"$smalto" man "$share/man/man1" >/dev/null
"$smalto" completions bash > "$share/bash-completion/completions/smalto"
"$smalto" completions zsh > "$share/zsh/site-functions/_smalto"
"$smalto" completions fish > "$share/fish/vendor_completions.d/smalto.fish"
install -m 644 packaging/smalto.desktop "$share/applications/"
install -m 644 packaging/smalto.svg "$share/icons/hicolor/scalable/apps/"

cp README.md CHANGELOG.md CONTRIBUTING.md LICENSE-MIT LICENSE-APACHE "$share/doc/smalto/"
cp -r docs/. "$share/doc/smalto/docs/"
python3 packaging/licences.py > "$share/doc/smalto/THIRD-PARTY.md"

# The same files make the same archive: names in order, no owner, the time of the last commit.
time=$(git log -1 --format=%ct)
tar --create --gzip --file "$dist/$name.tar.gz" --directory "$dist" --sort=name --owner=0 --group=0 --numeric-owner \
    --mtime="@$time" "$name"
echo "$dist/$name.tar.gz"
