"""The fixture `simulator`, and the option --gantry-bin for where Gantry's programs are."""

pytest_plugins = ["gantry.testing.plugin"]
