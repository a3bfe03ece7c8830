#!/usr/bin/env bash
# Installs what building and testing smalto needs and this machine lacks: a C++ compiler, CMake, git and Python (for the
# shader compiler), Rust, the Vulkan loader, a driver, the validation layer, the libraries that a window takes, and for the
# tests an X server without a screen and a window manager. Says nothing when nothing is missing.
set -euo pipefail

has() { command -v "$1" >/dev/null 2>&1; }
has_file() { compgen -G "$1" >/dev/null; }
has_library() { { ldconfig -p 2>/dev/null || /sbin/ldconfig -p; } | grep "$1" >/dev/null; }

missing=()
has c++ || missing+=(compiler)
has cmake || missing+=(cmake)
has git || missing+=(git)
has python3 || missing+=(python)
has cargo || missing+=(rust)
has_library libvulkan.so.1 || missing+=(loader)
{ has_file '/usr/share/vulkan/icd.d/*.json' || has_file '/etc/vulkan/icd.d/*.json'; } || missing+=(driver)
{ has_file '/usr/share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json' ||
    has_file '/etc/vulkan/explicit_layer.d/VkLayer_khronos_validation.json'; } || missing+=(validation)
has_library libX11-xcb.so.1 || missing+=(x11-xcb)
has_library libXcursor.so.1 || missing+=(xcursor)
has_library libXi.so.6 || missing+=(xi)
has_library libXrandr.so.2 || missing+=(xrandr)
has_library libxkbcommon-x11.so.0 || missing+=(xkbcommon-x11)
has Xvfb || missing+=(xvfb)
has openbox || missing+=(openbox)
[ ${#missing[@]} -eq 0 ] && exit 0

# What each is called: Debian and Ubuntu, Fedora, Arch.
package() {
    case "$1:$2" in
        apt:compiler) echo g++ ;;
        dnf:compiler) echo gcc-c++ ;;
        pacman:compiler) echo gcc ;;
        *:cmake) echo cmake ;;
        *:git) echo git ;;
        pacman:python) echo python ;;
        *:python) echo python3 ;;
        dnf:rust) echo cargo ;;
        pacman:rust) echo rust ;;
        apt:loader) echo libvulkan1 ;;
        dnf:loader) echo vulkan-loader ;;
        pacman:loader) echo vulkan-icd-loader ;;
        pacman:driver) echo vulkan-swrast ;;
        *:driver) echo mesa-vulkan-drivers ;;
        apt:validation) echo vulkan-validationlayers ;;
        *:validation) echo vulkan-validation-layers ;;
        apt:x11-xcb) echo libx11-xcb1 ;;
        dnf:x11-xcb) echo libX11-xcb ;;
        pacman:x11-xcb) echo libx11 ;;
        apt:xcursor) echo libxcursor1 ;;
        dnf:xcursor) echo libXcursor ;;
        pacman:xcursor) echo libxcursor ;;
        apt:xi) echo libxi6 ;;
        dnf:xi) echo libXi ;;
        pacman:xi) echo libxi ;;
        apt:xrandr) echo libxrandr2 ;;
        dnf:xrandr) echo libXrandr ;;
        pacman:xrandr) echo libxrandr ;;
        apt:xkbcommon-x11) echo libxkbcommon-x11-0 ;;
        *:xkbcommon-x11) echo libxkbcommon-x11 ;;
        apt:xvfb) echo xvfb ;;
        dnf:xvfb) echo xorg-x11-server-Xvfb ;;
        pacman:xvfb) echo xorg-server-xvfb ;;
        *:openbox) echo openbox ;;
    esac
}

manager=
for candidate in apt-get dnf pacman; do
    if has "$candidate"; then manager=${candidate%-get}; break; fi
done
root=
[ "$(id -u)" -eq 0 ] || root=sudo

packages=()
for what in "${missing[@]}"; do
    if [ "$what" = rust ] && [ "$manager" != dnf ] && [ "$manager" != pacman ]; then
        echo "Rust is missing and no package here is new enough: install it with rustup, https://rustup.rs, then run this again." >&2
        exit 1
    fi
    [ -n "$manager" ] && packages+=("$(package "$manager" "$what")")
done

echo "smalto needs: ${missing[*]}"
case "$manager" in
    apt) $root apt-get update -qq && $root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${packages[@]}" >/dev/null ;;
    dnf) $root dnf install -y -q "${packages[@]}" ;;
    pacman) $root pacman -S --needed --noconfirm --quiet "${packages[@]}" ;;
    *)
        echo "No package manager that this script knows (apt, dnf, pacman). Please install: a C++ compiler, CMake, git," \
            "Python 3, Rust, the Vulkan loader, a Vulkan driver (your GPU's, or Mesa's lavapipe), the Khronos validation layer," \
            "the X11 libraries of windows (xcb, Xcursor, Xi, Xrandr, xkbcommon), Xvfb, openbox." >&2
        exit 1
        ;;
esac
