/*
 * A virtual Modbus device that speaks the real protocol: a drive with a stepper motor, a relay
 * board and a board of inputs in one unit. It serves TCP on the loopback interface, or RTU on a
 * pseudo-terminal, in a separate thread and in real time. It is for tests, measurements and
 * mesorig-rig.
 *
 * Holding registers:
 *   0–1      target position (32 bits, high word first)
 *   2        command: 1 start, 2 home, 3 stop, 4 clear
 *   3        speed; it has no effect if speed_unit_steps_s is 0
 *   4        acceleration; it has no effect
 *   5        watchdog; writes are counted
 *   6        communication timeout in 0.1 s, or 0 for none. If no request arrives within this time,
 *            the coils are switched off and the drive brakes.
 *   100–107  no function (RIG_AXIS of tests/lib/modbus_rig.h sets up 100–102)
 * Input registers, which can also be read as holding registers:
 *   20       status: bit 0 moving, 1 homed, 2 fault, 3 limit
 *   21–22    position (32 bits)
 * There are coils 0–15 and discrete inputs 0–15. Function 5 at coil 0x200 + i with a time in 0.1 s
 * switches coil i on for this time. All other addresses are illegal.
 *
 * Any thread may call these functions, except virtual_modbus_new() and virtual_modbus_free().
 */
#pragma once

#include <glib.h>

#define VIRTUAL_MODBUS_STATUS  20 /* the next two registers are the position */
#define VIRTUAL_MODBUS_TIMEOUT 6
#define VIRTUAL_MODBUS_PLAIN   100
#define VIRTUAL_MODBUS_PULSE   0x200
#define VIRTUAL_MODBUS_BITS    16

typedef struct VirtualModbus VirtualModbus;

struct virtual_modbus_options {
    gboolean rtu;
    int unit;
    double speed_steps_s, accel_steps_s2; /* true values, independent of the drive's registers */
    /* Unit of the speed register (3) in steps/s. 0: the register has no effect. */
    double speed_unit_steps_s;
};

VirtualModbus *virtual_modbus_new(const struct virtual_modbus_options *options, GError **error);
void virtual_modbus_free(VirtualModbus *device); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualModbus, virtual_modbus_free)

/* Returns the value of "bus" for a section of a rig file. */
const char *virtual_modbus_bus(const VirtualModbus *device);

/* The faults that virtual_modbus_fail() sets. skip, late, damaged, silent, refused and lost are
 * counters. Each affected request decreases its counter by one. A counter of −1 never ends. While
 * skip is not 0, the faults of the other counters do not happen, and these counters do not change.
 */
struct virtual_modbus_faults {
    int skip;          /* replies that are still correct */
    int late, late_ms; /* number of replies that are sent late, and their delay in ms */
    /* Replies with a wrong checksum. With TCP, the reply has a wrong transaction id instead. */
    int damaged;
    int silent;             /* requests that are carried out but not answered */
    int refused, exception; /* number of requests that are refused, and the exception code */
    /* `lost`: number of writes that are carried out but not answered. `dead_ms`: time after each of
     * these writes in which no request arrives. */
    int lost, dead_ms;
    int delay_us;     /* delay of the wire, added to every reply */
    gboolean blocked; /* the motor cannot turn, although the drive reports that it moves */
    gboolean deaf;    /* coils do not switch, although writes to them are answered as usual */
    gboolean cut;     /* no request arrives */
};
void virtual_modbus_fail(VirtualModbus *device, const struct virtual_modbus_faults *faults);

/* Switches the power off, and on again after down_ms. The coils are then off. The reference
 * position is lost, and positions count from 0. */
void virtual_modbus_restart(VirtualModbus *device, int down_ms);

struct virtual_modbus_state {
    double position_steps;
    gboolean moving, homed, faulty;
    gint64 began_us; /* time of g_get_monotonic_time() when the last motion began */
    gboolean coils[VIRTUAL_MODBUS_BITS];
    /* numbers of requests, of writes to the watchdog register, of connections and of pulses */
    int requests, watchdogs, connections, pulses;
    int timeouts; /* number of times that the communication timeout has expired */
    /* Length of the communication timeout that has expired last, or of the pulse that has ended
     * last, whichever was later. 0 if there was none. */
    int expired_ms;
    /* Time of g_get_monotonic_time() when requests arrive again after the fault `lost`. 0 if this
     * fault has not happened. */
    gint64 usable_us;
    guint16 speed, accel;
};
void virtual_modbus_state(VirtualModbus *device, struct virtual_modbus_state *ret);

void virtual_modbus_set_input(VirtualModbus *device, int index, gboolean on);
/* Switches a coil without a request on the line, as if an earlier program had switched it. */
void virtual_modbus_set_coil(VirtualModbus *device, int index, gboolean on);
/* Sets the register VIRTUAL_MODBUS_PLAIN + index. */
void virtual_modbus_set_plain(VirtualModbus *device, int index, guint16 value);
void virtual_modbus_set_drive_fault(VirtualModbus *device, gboolean faulty);
