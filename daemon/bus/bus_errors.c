#include "bus_errors.h"

#include "drivers/device.h"
#include "geometry/rig.h"
#include "plan/plan.h"
#include "session/session.h"

#define NAME(suffix) "org.mesorig.Error." suffix

static const GDBusErrorEntry bus_names[] = {
    {BUS_ERROR_BUSY, NAME("Busy")},
    {BUS_ERROR_NO_RIG, NAME("NoRig")},
    {BUS_ERROR_NO_SESSION, NAME("NoSession")},
    {BUS_ERROR_BAD_PATH, NAME("BadPath")},
    {BUS_ERROR_UNKNOWN, NAME("Unknown")},
    {BUS_ERROR_NO_PICTURE, NAME("NoPicture")},
    {BUS_ERROR_FAILED, NAME("Failed")},
    {BUS_ERROR_LIMIT, NAME("Limit")},
    {BUS_ERROR_CANCELLED, NAME("Cancelled")},
};

static const GDBusErrorEntry config_names[] = {
    {CONFIG_ERROR_SYNTAX, NAME("ConfigSyntax")},
    {CONFIG_ERROR_UNKNOWN, NAME("ConfigUnknown")},
    {CONFIG_ERROR_MISSING, NAME("ConfigMissing")},
    {CONFIG_ERROR_VALUE, NAME("ConfigValue")},
};

static const GDBusErrorEntry device_names[] = {
    {DEVICE_ERROR_RANGE, NAME("DeviceRange")},
    {DEVICE_ERROR_BUSY, NAME("DeviceBusy")},
    {DEVICE_ERROR_TIMEOUT, NAME("DeviceTimeout")},
    {DEVICE_ERROR_DISCONNECTED, NAME("DeviceDisconnected")},
    {DEVICE_ERROR_STALLED, NAME("DeviceStalled")},
    {DEVICE_ERROR_INTERLOCK, NAME("DeviceInterlock")},
    {DEVICE_ERROR_PROTOCOL, NAME("DeviceProtocol")},
    {DEVICE_ERROR_STALE, NAME("DeviceStale")},
    {DEVICE_ERROR_UNSUPPORTED, NAME("DeviceUnsupported")},
};

static const GDBusErrorEntry session_names[] = {
    {SESSION_ERROR_IO, NAME("SessionIO")},         {SESSION_ERROR_FORMAT, NAME("SessionFormat")},
    {SESSION_ERROR_LOCKED, NAME("SessionLocked")}, {SESSION_ERROR_EXISTS, NAME("SessionExists")},
    {SESSION_ERROR_FULL, NAME("SessionFull")},     {SESSION_ERROR_DAMAGED, NAME("SessionDamaged")},
};

static const GDBusErrorEntry plan_names[] = {
    {PLAN_ERROR_NO_CAMERA, NAME("PlanNoCamera")}, {PLAN_ERROR_NO_LAMP, NAME("PlanNoLamp")},
    {PLAN_ERROR_NO_LASER, NAME("PlanNoLaser")},   {PLAN_ERROR_LIMITS, NAME("PlanLimits")},
    {PLAN_ERROR_BLOCKED, NAME("PlanBlocked")},    {PLAN_ERROR_SIZE, NAME("PlanSize")},
};

static const GDBusErrorEntry rig_names[] = {
    {RIG_ERROR_FORMAT, NAME("RigFormat")},
    {RIG_ERROR_VALUE, NAME("RigValue")},
};

G_DEFINE_QUARK(bus_error, bus_error)

static const struct {
    GQuark (*domain)(void);
    const GDBusErrorEntry *names;
    gsize n;
} domains[] = {
    {bus_error_quark, bus_names, G_N_ELEMENTS(bus_names)},
    {config_error_quark, config_names, G_N_ELEMENTS(config_names)},
    {device_error_quark, device_names, G_N_ELEMENTS(device_names)},
    {session_error_quark, session_names, G_N_ELEMENTS(session_names)},
    {plan_error_quark, plan_names, G_N_ELEMENTS(plan_names)},
    {rig_error_quark, rig_names, G_N_ELEMENTS(rig_names)},
};

void bus_errors_register(void) {
    static gsize once;
    if (!g_once_init_enter(&once))
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(domains); i++)
        for (gsize j = 0; j < domains[i].n; j++)
            g_dbus_error_register_error(domains[i].domain(), domains[i].names[j].error_code,
                                        domains[i].names[j].dbus_error_name);
    g_once_init_leave(&once, 1);
}

GError *bus_errors_wrap(GError *error) {
    for (gsize i = 0; i < G_N_ELEMENTS(domains); i++)
        if (error->domain == domains[i].domain())
            return error;
    GError *wrapped = g_error_new_literal(BUS_ERROR, BUS_ERROR_FAILED, error->message);
    g_error_free(error);
    return wrapped;
}
