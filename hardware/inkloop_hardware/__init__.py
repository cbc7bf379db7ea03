"""inkloop on a CAN bus: protocol, transport, device components and the emulator.

Public, for programs outside this project:

- the component kinds `hardware.printer`, `hardware.profiler` and `hardware.mapped` of a scenario,
- `link.rig.Rig` with `bus.settings.BusSettings`: a bench with its nodes, and a link to each of them,
- `protocol.codec.Codec`, `protocol.records` and `protocol/inkloop.dbc`: the frames,
- `emulated_bench.EmulatedBench`: the nodes and the printer behind them as a process,
- `doctor.doctor.examine`: the checks of a bench,
- the classes of `errors`.

Everything else may change between versions. Rooms, each of which imports only those before it: `errors`, `protocol`,
`bus`, `replay`, `link`, then `devices` and `mapped`, then `doctor`.
"""
