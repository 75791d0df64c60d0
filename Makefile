# The words that run everything. `make demo` and `make test` need cargo, python3 with pip, and the package registries.
.PHONY: demo test check format lint docs arrows onnxruntime conformance node-tests models models-test page-test thesis python data clean

SHELL := /bin/bash
CARGO ?= cargo
PYTHON := models/.venv/bin/python
VITRUVIAN := target/release/vitruvian

demo: onnxruntime
	$(CARGO) run --release -- demo -o out/demo

test: onnxruntime
	$(CARGO) test --release --workspace

check: format lint docs arrows test

format:
	$(CARGO) fmt --all --check

lint:
	$(CARGO) clippy --release --workspace --all-targets -- -D warnings

docs:
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --release --workspace --no-deps

# The reference depends on nothing; the runtime never reaches the reference (ARCHITECTURE.md).
arrows:
	scripts/arrows.sh

# ONNX Runtime's library out of its wheel, pinned by SHA-256, into vendor/onnxruntime.
onnxruntime:
	scripts/onnxruntime.sh

# The long form of the operator suite: at least 10 000 random cases, a table per operator.
conformance: onnxruntime
	$(CARGO) run --release -p vitruvian-conformance --example sweep -- --cases 10000

# The official ONNX backend tests, written by their pinned package (not committed), on every engine: docs/node_tests.md.
# The feature is the third opinion, which takes some minutes to build.
node-tests: onnxruntime python
	$(PYTHON) conformance/node_tests/generate.py
	$(CARGO) run --release -p vitruvian-conformance --features tract --example node_tests -- -o docs/node_tests.md

# PyTorch and the ONNX tools, pinned, for everything below.
python: models/.venv/installed
models/.venv/installed: models/requirements.txt
	python3 -m venv models/.venv
	$(PYTHON) -m pip install --quiet --disable-pip-version-check -r models/requirements.txt
	touch $@

models-test: python
	cd models && .venv/bin/python -m unittest discover -s . -t .

# The audit's page in headless Chromium, made from a real audit and from a planted fault.
page-test: onnxruntime python
	$(CARGO) build --release
	tests/page/run.sh

# Thesis-size graphs, both fillings, into models/exported/thesis (not committed).
thesis: python
	$(PYTHON) models/export.py --size thesis --filling random -o models/exported/thesis/random
	$(PYTHON) models/export.py --size thesis --filling widened -o models/exported/thesis/widened

# Everything from seeds to graphs: data, training (about four hours on two cores), export. BODY adds a second body.
models: python onnxruntime
	$(CARGO) build --release
	models/train.sh $(BODY)

clean:
	$(CARGO) clean
	rm -rf out models/data models/runs
