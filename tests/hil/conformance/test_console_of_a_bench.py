from phasewire.hil.conformance.running import RunOptions, open_bench
from phasewire.protocol.framing import LineMode


def test_the_console_answers_in_each_case_after_any_other() -> None:
    with open_bench(RunOptions("emulator:")) as bench:
        bench.begin_case("one that leaves frames behind, and no DTR")
        bench.serial.enter_frames()
        bench.usb.set_configuration()
        bench.begin_case("the next")
        bench.serial.enter_console()
        assert bench.serial.mode is LineMode.CONSOLE
        assert "faults: none" in bench.serial.command("faults")
