#!/usr/bin/env bash
# Installs what building and testing smalto needs and this machine lacks. Prints nothing if nothing is missing.
set -euo pipefail

has() { command -v "$1" >/dev/null 2>&1; }
has_lib() { { ldconfig -p 2>/dev/null || /sbin/ldconfig -p; } | grep "$1" >/dev/null; }
has_vulkan() { compgen -G "/usr/share/vulkan/$1" || compgen -G "/etc/vulkan/$1"; } >/dev/null

manager=
for candidate in apt-get dnf pacman; do
    if has "$candidate"; then manager=$candidate; break; fi
done

# CMake, make, git, Python and the C++ compiler build the shader compiler. The tests need the validation layer, Xvfb,
# openbox, weston and Chromium.
names=() packages=()
while read -r name apt dnf pacman check; do
    if $check; then continue; fi
    names+=("$name")
    case "$manager" in
        apt-get) package=$apt ;;
        dnf) package=$dnf ;;
        *) package=$pacman ;;
    esac
    if [ "$package" != - ]; then packages+=("$package"); fi
done <<'TABLE'
c++       g++                     gcc-c++                  gcc                      has c++
cmake     cmake                   cmake                    cmake                    has cmake
make      make                    make                     make                     has make
git       git                     git                      git                      has git
python    python3                 python3                  python                   has python3
rust      -                       cargo                    rust                     has cargo
loader    libvulkan1              vulkan-loader            vulkan-icd-loader        has_lib libvulkan.so.1
driver    mesa-vulkan-drivers     mesa-vulkan-drivers      vulkan-swrast            has_vulkan icd.d/*.json
layer     vulkan-validationlayers vulkan-validation-layers vulkan-validation-layers has_vulkan explicit_layer.d/*valid*
x11-xcb   libx11-xcb1             libX11-xcb               libx11                   has_lib libX11-xcb.so.1
xcursor   libxcursor1             libXcursor               libxcursor               has_lib libXcursor.so.1
xi        libxi6                  libXi                    libxi                    has_lib libXi.so.6
xrandr    libxrandr2              libXrandr                libxrandr                has_lib libXrandr.so.2
xkbcommon libxkbcommon-x11-0      libxkbcommon-x11         libxkbcommon-x11         has_lib libxkbcommon-x11.so.0
xvfb      xvfb                    xorg-x11-server-Xvfb     xorg-server-xvfb         has Xvfb
openbox   openbox                 openbox                  openbox                  has openbox
weston    weston                  weston                   weston                   has weston-screenshooter
chromium  chromium                chromium                 chromium                 has chromium
TABLE
[ ${#names[@]} -eq 0 ] && exit 0

echo "smalto needs: ${names[*]}"
root=
[ "$(id -u)" -eq 0 ] || root=sudo
if [ -z "$manager" ]; then
    echo "Neither apt, dnf nor pacman is here. Please install these with your system's package manager." >&2
    exit 1
fi
if [ ${#packages[@]} -gt 0 ]; then
    case "$manager" in
        apt-get)
            $root apt-get update -qq
            $root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${packages[@]}" >/dev/null
            ;;
        dnf) $root dnf install -y -q "${packages[@]}" ;;
        pacman) $root pacman -S --needed --noconfirm --quiet "${packages[@]}" ;;
    esac
fi
if [ "$manager" = apt-get ] && ! has cargo; then
    echo "Rust is missing: Debian's and Ubuntu's is too old. Install it with rustup (https://rustup.rs)." >&2
    exit 1
fi
