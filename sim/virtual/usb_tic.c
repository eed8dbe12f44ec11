#include "usb_tic.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#define STEP_US       500
#define SAFE_START_US 200000  /* duration of an "exit safe start" */
#define HOMING_SPEED  20000.0 /* steps per second; a real Tic has a setting for this speed */
/* Distance in steps between the positions at which the reverse switch opens and closes. */
#define SWITCH_DISTANCE 20.0

enum error_bit { DEENERGIZED = 0, TIMED_OUT = 6, SAFE_START = 7 };
enum control_state { HOLDING, TO_POSITION, AT_VELOCITY, HOMING_TOWARDS, HOMING_AWAY };

struct VirtualTic {
    VirtualUsb *usb;
    struct virtual_usb_class class;
    char *serial;
    double travel;
    int mode, timeout_ms;
    gboolean blocked, cut;

    gint64 now_us, command_us, safe_start_us;
    gboolean energized, uncertain;
    enum control_state state;
    int homing; /* direction of homing: −1 or 1 */
    /* `origin`: true position, in steps, at which the Tic reports position 0 */
    double steps, origin, velocity, top_speed;
    gint32 target_position, target_velocity;
    double max_speed, max_accel, max_decel;

    struct world_part part; /* the axis of the world that the motor turns */
    double steps_per_deg, zero_steps;
};

/* A configuration with a single interface of a Tic: vendor-specific, without endpoints. */
static const guint8 config[] = {9, 2, 18, 0, 1, 1, 0, 0xc0, 50, 9, 4, 0, 0, 0, 0xff, 0, 0, 0};

static gboolean pressed(const VirtualTic *tic, int direction) {
    if (tic->travel == 0 || tic->cut)
        return FALSE;
    if (direction > 0)
        return tic->blocked || tic->steps >= tic->travel;
    return tic->steps <= -SWITCH_DISTANCE ||
           (tic->state == HOMING_AWAY && tic->homing < 0 && tic->steps < 0);
}

static int errors(const VirtualTic *tic) {
    int bits = 0;
    if (!tic->energized)
        bits |= 1 << DEENERGIZED;
    if (tic->timeout_ms && tic->now_us - tic->command_us > tic->timeout_ms * 1000)
        bits |= 1 << TIMED_OUT;
    /* The error "safe start" begins together with any other error. It lasts until the command "exit
     * safe start". */
    if (tic->now_us > tic->safe_start_us)
        bits |= 1 << SAFE_START;
    return bits;
}

static double wanted_velocity(const VirtualTic *tic, gboolean well) {
    double distance = tic->target_position + tic->origin - tic->steps;
    if (!well || tic->state == HOLDING)
        return 0;
    if (tic->state == AT_VELOCITY)
        return tic->target_velocity / 10000.0;
    if (tic->state == HOMING_TOWARDS)
        return tic->homing * HOMING_SPEED;
    if (tic->state == HOMING_AWAY)
        return -tic->homing * HOMING_SPEED / 10;
    double brake = sqrt(2 * tic->max_decel * 0.9 * fabs(distance));
    return copysign(MIN(tic->max_speed, brake), distance);
}

static void halt(VirtualTic *tic) {
    tic->velocity = 0;
    tic->state = HOLDING;
    tic->uncertain = TRUE;
}

static void usb_tic_step(VirtualTic *tic, double dt) {
    int bits = errors(tic);
    if (bits == 0) /* in normal operation, "safe start" does not begin again by itself */
        tic->safe_start_us = MAX(tic->safe_start_us, tic->now_us + STEP_US);
    double wanted = wanted_velocity(tic, bits == 0);
    double most = (fabs(wanted) > fabs(tic->velocity) ? tic->max_accel : tic->max_decel) * dt;
    tic->velocity += CLAMP(wanted - tic->velocity, -most, most);
    tic->steps += tic->velocity * dt;
    tic->top_speed = MAX(tic->top_speed, fabs(tic->velocity));
    double left = tic->target_position + tic->origin - tic->steps;
    if (tic->state == TO_POSITION && fabs(left) < 1 &&
        fabs(tic->velocity) < 2 * sqrt(tic->max_decel)) {
        tic->steps += left;
        tic->velocity = 0;
    }
    int direction = (tic->velocity > 0) - (tic->velocity < 0);
    if (tic->state == HOMING_AWAY && !pressed(tic, tic->homing)) {
        tic->origin = tic->steps;
        tic->velocity = 0;
        tic->state = HOLDING;
        tic->uncertain = FALSE;
    } else if (direction && pressed(tic, direction)) {
        tic->velocity = 0;
        if (tic->state == HOMING_TOWARDS && direction == tic->homing)
            tic->state = HOMING_AWAY;
        else
            halt(tic);
    }
}

static void usb_tic_run(VirtualTic *tic) {
    gint64 now = g_get_monotonic_time();
    while (tic->now_us + STEP_US <= now) {
        tic->now_us += STEP_US;
        usb_tic_step(tic, STEP_US * 1e-6);
    }
    if (tic->part.kind != WORLD_PART_NONE)
        world_part_turn(&tic->part, (tic->steps - tic->zero_steps) / tic->steps_per_deg,
                        tic->velocity / tic->steps_per_deg, tic->now_us);
}

static void put32(guint8 *data, gint64 value) {
    for (int i = 0; i < 4; i++)
        data[i] = (guint8)((guint64)value >> 8 * i);
}

static int get_variable(const VirtualTic *tic, int offset, int length, guint8 *data) {
    guint8 all[0x56] = {0};
    int bits = errors(tic);
    gboolean homing = tic->state == HOMING_TOWARDS || tic->state == HOMING_AWAY;
    if (length < 1 || offset + length > (int)sizeof all)
        return -EPIPE;
    all[0x00] = bits == 0 ? 10 : bits & 1 ? 2 : 4;
    all[0x01] =
        (guint8)((tic->energized ? 1 : 0) | (tic->uncertain ? 2 : 0) | (pressed(tic, 1) ? 4 : 0) |
                 (pressed(tic, -1) ? 8 : 0) | (homing ? 16 : 0));
    all[0x02] = (guint8)bits;
    put32(all + 0x0a, tic->target_position);
    put32(all + 0x22, llround(tic->steps - tic->origin));
    put32(all + 0x26, llround(tic->velocity * 10000));
    memcpy(data, all + offset, (gsize)length);
    return length;
}

static int usb_tic_get_setting(const VirtualTic *tic, int offset, int length, guint8 *data) {
    guint8 all[0x60] = {0};
    if (length < 1 || offset + length > (int)sizeof all)
        return -EPIPE;
    all[0x01] = (guint8)tic->mode;
    all[0x09] = (guint8)tic->timeout_ms;
    all[0x0a] = (guint8)(tic->timeout_ms >> 8);
    memcpy(data, all + offset, (gsize)length);
    return length;
}

/* Carries out a request. Requests of this kind restart the command timeout. */
static void usb_tic_command(VirtualTic *tic, int request, gint32 value) {
    gboolean obeys = tic->mode == 0;
    tic->command_us = tic->now_us;
    if (request == 0x83)
        tic->safe_start_us = MAX(tic->safe_start_us, tic->now_us + SAFE_START_US);
    else if (request == 0x85)
        tic->energized = TRUE;
    else if (request == 0x89 && obeys)
        halt(tic);
    else if (request == 0xe0 && obeys) {
        tic->target_position = value;
        tic->state = TO_POSITION;
    } else if (request == 0xe3 && obeys) {
        tic->target_velocity = value;
        tic->state = AT_VELOCITY;
    } else if (request == 0xec && obeys) {
        tic->origin = tic->steps - value;
        tic->velocity = 0;
        tic->state = HOLDING;
        tic->uncertain = FALSE;
    }
}

static int usb_tic_control(gpointer model, const guint8 *setup, guint8 *data) {
    VirtualTic *tic = model;
    int request = setup[1], value = setup[2] | setup[3] << 8, index = setup[4] | setup[5] << 8;
    gint32 both = (gint32)((guint32)value | (guint32)index << 16);
    int length = setup[6] | setup[7] << 8;
    usb_tic_run(tic);
    if (setup[0] == 0xc0 && request == 0xa1)
        return get_variable(tic, index, length, data);
    if (setup[0] == 0xc0 && request == 0xa8)
        return usb_tic_get_setting(tic, index, length, data);
    if (setup[0] != 0x40)
        return -EPIPE;
    switch (request) {
    case 0x83:
    case 0x85:
    case 0x89:
    case 0x8c:
    case 0xe0:
    case 0xe3:
    case 0xec:
        usb_tic_command(tic, request, both);
        return 0;
    case 0x86:
        tic->energized = FALSE;
        tic->uncertain = TRUE;
        return 0;
    case 0x8a:
        return 0;
    case 0x97:
        tic->homing = value ? 1 : -1;
        tic->state = HOMING_TOWARDS;
        tic->uncertain = TRUE;
        return 0;
    case 0xe6:
        tic->max_speed = (guint32)both / 10000.0;
        return 0;
    case 0xe9:
        tic->max_decel = (guint32)both / 100.0;
        return 0;
    case 0xea:
        tic->max_accel = (guint32)both / 100.0;
        return 0;
    default:
        return -EPIPE;
    }
}

VirtualTic *virtual_tic_new(const char *serial, int port, double travel, double at) {
    VirtualTic *tic = g_new0(VirtualTic, 1);
    tic->serial = g_strdup(serial);
    tic->class = (struct virtual_usb_class){0x1ffb, 0x00b5,        "Tic T834",     tic->serial,
                                            config, sizeof config, usb_tic_control};
    tic->travel = travel;
    tic->timeout_ms = 1000;
    tic->now_us = tic->command_us = g_get_monotonic_time();
    tic->energized = tic->uncertain = TRUE;
    tic->steps = tic->origin = at;
    tic->max_speed = 200;
    tic->max_accel = tic->max_decel = 400;
    tic->usb = virtual_usb_new(&tic->class, port, tic);
    return tic;
}

void virtual_tic_free(VirtualTic *tic) {
    if (!tic)
        return;
    virtual_usb_free(tic->usb);
    world_part_clear(&tic->part);
    g_free(tic->serial);
    g_free(tic);
}

VirtualUsb *virtual_tic_usb(VirtualTic *tic) {
    return tic->usb;
}

static void usb_tic_enter(VirtualTic *tic) {
    virtual_usb_lock(tic->usb);
    usb_tic_run(tic);
}

static void usb_tic_leave(VirtualTic *tic) {
    virtual_usb_unlock(tic->usb);
}

gboolean virtual_tic_link(VirtualTic *tic, World *world, const char *part, double steps_per_deg,
                          double zero_steps, GError **error) {
    struct world_part found = {0};
    g_return_val_if_fail(steps_per_deg != 0, FALSE);
    if (!world_part_find(world, part, &found, error))
        return FALSE;
    virtual_usb_lock(tic->usb);
    struct world_part before = tic->part;
    tic->part = found;
    tic->steps_per_deg = steps_per_deg;
    tic->zero_steps = zero_steps;
    usb_tic_run(tic);
    virtual_usb_unlock(tic->usb);
    world_part_clear(&before);
    return TRUE;
}

void virtual_tic_set_mode(VirtualTic *tic, int control_mode, int command_timeout_ms) {
    usb_tic_enter(tic);
    tic->mode = control_mode;
    tic->timeout_ms = command_timeout_ms;
    usb_tic_leave(tic);
}

void virtual_tic_enter_safe_start(VirtualTic *tic) {
    usb_tic_enter(tic);
    tic->safe_start_us = 0;
    usb_tic_leave(tic);
}

void virtual_tic_lose_steps(VirtualTic *tic) {
    usb_tic_enter(tic);
    tic->uncertain = TRUE;
    usb_tic_leave(tic);
}

void virtual_tic_block_switch(VirtualTic *tic, gboolean blocked) {
    usb_tic_enter(tic);
    tic->blocked = blocked;
    usb_tic_leave(tic);
}

void virtual_tic_cut_switches(VirtualTic *tic) {
    usb_tic_enter(tic);
    tic->cut = TRUE;
    usb_tic_leave(tic);
}

double virtual_tic_steps(VirtualTic *tic) {
    usb_tic_enter(tic);
    double steps = tic->steps;
    usb_tic_leave(tic);
    return steps;
}

double virtual_tic_speed(VirtualTic *tic) {
    usb_tic_enter(tic);
    double speed = fabs(tic->velocity);
    usb_tic_leave(tic);
    return speed;
}

double virtual_tic_top_speed(VirtualTic *tic) {
    usb_tic_enter(tic);
    double speed = tic->top_speed;
    usb_tic_leave(tic);
    return speed;
}

gboolean virtual_tic_has_timed_out(VirtualTic *tic) {
    usb_tic_enter(tic);
    gboolean has = errors(tic) & 1 << TIMED_OUT;
    usb_tic_leave(tic);
    return has;
}
