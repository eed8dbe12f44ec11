/*
 * A virtual Modbus device that speaks the real protocol: a drive with a stepper motor, a relay
 * board and a board of inputs in one unit. It serves TCP on the loopback interface, or RTU on a
 * pseudo-terminal, in a thread of its own and in real time. For tests and measurements.
 *
 * Holding registers: 0–1 target (32 bits, high word first), 2 command (1 start, 2 home, 3 stop,
 * 4 clear), 3 speed, 4 acceleration (stored without effect;
 * so is the speed if speed_unit_steps_s is 0), 5 watchdog (writes are counted), 6 communication
 * timeout in 0.1 s (0: none; if no request comes for so long, the coils go off and the drive
 * brakes), 100–107 plain (RIG_AXIS of tests/lib/modbus_rig.h sets up
 * 100–102).
 * Input registers and, for reading, holding registers from 20 on: status (bit 0 moving, 1 homed,
 * 2 fault, 3 limit), position (32 bits). Coils 0–15, discrete inputs 0–15. Function 5
 * at coil 0x200 + i with a time in 0.1 s switches coil i on for so long. Anything else is an
 * illegal address.
 *
 * Any thread may call these functions, except new and free.
 */
#pragma once

#include <glib.h>

#define VIRTUAL_MODBUS_STATUS  20 /* position: the two after it */
#define VIRTUAL_MODBUS_TIMEOUT 6
#define VIRTUAL_MODBUS_PLAIN   100
#define VIRTUAL_MODBUS_PULSE   0x200
#define VIRTUAL_MODBUS_BITS    16

typedef struct VirtualModbus VirtualModbus;

struct virtual_modbus_options {
    gboolean rtu;
    int unit;
    double speed_steps_s, accel_steps_s2; /* whatever the drive's registers hold */
    double speed_unit_steps_s; /* unit of the speed register; 0: that register has no effect */
};

VirtualModbus *virtual_modbus_new(const struct virtual_modbus_options *options, GError **error);
void virtual_modbus_free(VirtualModbus *device); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualModbus, virtual_modbus_free)

/* The value of "bus" in a section. */
const char *virtual_modbus_bus(const VirtualModbus *device);

/* The faults that virtual_modbus_fail() sets. skip, late, damaged, silent, refused and lost are
 * counts: each request that one of them concerns lowers it by one, and −1 never ends. Until skip
 * has come to 0, the other counts stay as they are. */
struct virtual_modbus_faults {
    int skip;               /* replies that are still good */
    int late, late_ms;      /* replies that are sent late_ms after they were made */
    int damaged;            /* replies with a wrong check sum (TCP: of another transaction) */
    int silent;             /* requests that are carried out and not answered */
    int refused, exception; /* requests that are refused with this exception code */
    int lost, dead_ms; /* writes that are carried out and not answered; no request comes through for
                          dead_ms after one */
    int delay_us;      /* of the wire: added to every reply */
    gboolean blocked;  /* the motor cannot turn, though the drive says that it moves */
    gboolean deaf;     /* coils do not switch, though writing them is answered */
    gboolean cut;      /* no request comes through */
};
void virtual_modbus_fail(VirtualModbus *device, const struct virtual_modbus_faults *faults);

/* Power off and, after down_ms, on again: coils off, reference lost, counting from 0. */
void virtual_modbus_restart(VirtualModbus *device, int down_ms);

struct virtual_modbus_state {
    double position_steps;
    gboolean moving, homed, faulty;
    gint64 began_us; /* when the last motion began, of g_get_monotonic_time() */
    gboolean coils[VIRTUAL_MODBUS_BITS];
    int requests, watchdogs, connections, pulses;
    int timeouts;     /* how often its communication timeout has expired */
    gint64 usable_us; /* when the line is usable again after a lost answer, of
                         g_get_monotonic_time(); 0: no answer has been lost */
    guint16 speed, accel;
};
void virtual_modbus_state(VirtualModbus *device, struct virtual_modbus_state *ret);

void virtual_modbus_set_input(VirtualModbus *device, int index, gboolean on);
/* Switches a coil without a request on the line, as if by a program that has ended since. */
void virtual_modbus_set_coil(VirtualModbus *device, int index, gboolean on);
void virtual_modbus_set_plain(VirtualModbus *device, int index, guint16 value);
void virtual_modbus_set_drive_fault(VirtualModbus *device, gboolean faulty);
