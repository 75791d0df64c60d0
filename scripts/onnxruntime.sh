#!/bin/sh
# Brings the ONNX Runtime shared library out of the official PyPI wheel into vendor/onnxruntime/.
#
# Why a wheel: it is the one place that serves the library as a plain file with a published hash and without
# a login. The wheel is only unzipped, never installed; which Python runs this does not matter, because the
# wheel's tags are pinned below. The SHA-256 is checked by pip; a wrong one ends the script and leaves nothing.
#
# Needs: sh, python3 with pip, a Python package index. Running it again does nothing when the library is there.
# Another platform: set ORT_DYLIB_PATH to an onnxruntime library of version 1.23 or newer instead.
set -eu

version=1.32.0
sha256=5a34fc4dfeb5a7b4a74c95dcba1e773d722abda720b474edf1b0c419dc6d163d
platform=manylinux_2_28_x86_64
python_version=3.11

root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
target=$root/vendor/onnxruntime
library=libonnxruntime.so.$version

fail() {
    echo "onnxruntime.sh: $1" >&2
    exit 1
}

if [ -f "$target/$library" ] && [ -e "$target/libonnxruntime.so" ]; then
    echo "ONNX Runtime $version is in ${target#"$root"/}"
    exit 0
fi

if [ "$(uname -s)" != Linux ] || [ "$(uname -m)" != x86_64 ]; then
    fail "the pinned wheel is for Linux on x86_64, this is $(uname -s) on $(uname -m).
Get ONNX Runtime 1.23 or newer for it (its Python package onnxruntime holds the library in onnxruntime/capi/),
then put the library into vendor/onnxruntime/ or point ORT_DYLIB_PATH at it."
fi
command -v python3 >/dev/null || fail "python3 is missing: install Python 3 with pip"
python3 -m pip --version >/dev/null 2>&1 || fail "python3 has no pip: install it (Debian: apt-get install python3-pip)"

# Everything happens in one folder beside the target (same file system, so the last step is a rename).
mkdir -p "$root/vendor"
work=$(mktemp -d "$root/vendor/.onnxruntime.XXXXXX")
trap 'rm -rf "$work"; rmdir "$root/vendor" 2>/dev/null || true' EXIT
trap 'exit 1' HUP INT TERM

printf 'onnxruntime==%s --hash=sha256:%s\n' "$version" "$sha256" >"$work/requirements.txt"
python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
    --python-version "$python_version" --implementation cp --platform "$platform" \
    --require-hashes -r "$work/requirements.txt" -d "$work/wheel" \
    || fail "pip could not bring onnxruntime $version with the pinned SHA-256 (its words are above); nothing was kept"
python3 -m zipfile -e "$work"/wheel/*.whl "$work/content"

mkdir "$work/ready"
cp "$work/content/onnxruntime/capi/$library" "$work/ready/"
cp "$work/content/onnxruntime/LICENSE" "$work/content/onnxruntime/ThirdPartyNotices.txt" "$work/ready/"
ln -s "$library" "$work/ready/libonnxruntime.so"
rm -rf "$target"
mv "$work/ready" "$target"
echo "ONNX Runtime $version is in ${target#"$root"/}"
