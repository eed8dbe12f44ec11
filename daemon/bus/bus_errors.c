#include "bus_errors.h"

#include <gio/gio.h>

#include "drivers/device.h"
#include "geometry/rig.h"
#include "plan/plan.h"
#include "session/session.h"

#define NAME(suffix) "org.mesorig.Error." suffix

G_DEFINE_QUARK(bus_error, bus_error)

static const struct {
    GQuark (*domain)(void);
    int code;
    const char *name;
} names[] = {
    {bus_error_quark, BUS_ERROR_BUSY, NAME("Busy")},
    {bus_error_quark, BUS_ERROR_NO_RIG, NAME("NoRig")},
    {bus_error_quark, BUS_ERROR_NO_SESSION, NAME("NoSession")},
    {bus_error_quark, BUS_ERROR_BAD_PATH, NAME("BadPath")},
    {bus_error_quark, BUS_ERROR_UNKNOWN, NAME("Unknown")},
    {bus_error_quark, BUS_ERROR_NO_PICTURE, NAME("NoPicture")},
    {bus_error_quark, BUS_ERROR_FAILED, NAME("Failed")},
    {bus_error_quark, BUS_ERROR_LIMIT, NAME("Limit")},
    {bus_error_quark, BUS_ERROR_CANCELLED, NAME("Cancelled")},
    {bus_error_quark, BUS_ERROR_LATCHED, NAME("Latched")},
    {bus_error_quark, BUS_ERROR_DENIED, NAME("Denied")},
    {config_error_quark, CONFIG_ERROR_SYNTAX, NAME("ConfigSyntax")},
    {config_error_quark, CONFIG_ERROR_UNKNOWN, NAME("ConfigUnknown")},
    {config_error_quark, CONFIG_ERROR_MISSING, NAME("ConfigMissing")},
    {config_error_quark, CONFIG_ERROR_VALUE, NAME("ConfigValue")},
    {device_error_quark, DEVICE_ERROR_RANGE, NAME("DeviceRange")},
    {device_error_quark, DEVICE_ERROR_BUSY, NAME("DeviceBusy")},
    {device_error_quark, DEVICE_ERROR_TIMEOUT, NAME("DeviceTimeout")},
    {device_error_quark, DEVICE_ERROR_DISCONNECTED, NAME("DeviceDisconnected")},
    {device_error_quark, DEVICE_ERROR_STALLED, NAME("DeviceStalled")},
    {device_error_quark, DEVICE_ERROR_INTERLOCK, NAME("DeviceInterlock")},
    {device_error_quark, DEVICE_ERROR_PROTOCOL, NAME("DeviceProtocol")},
    {device_error_quark, DEVICE_ERROR_STALE, NAME("DeviceStale")},
    {device_error_quark, DEVICE_ERROR_UNSUPPORTED, NAME("DeviceUnsupported")},
    {session_error_quark, SESSION_ERROR_IO, NAME("SessionIO")},
    {session_error_quark, SESSION_ERROR_FORMAT, NAME("SessionFormat")},
    {session_error_quark, SESSION_ERROR_LOCKED, NAME("SessionLocked")},
    {session_error_quark, SESSION_ERROR_EXISTS, NAME("SessionExists")},
    {session_error_quark, SESSION_ERROR_FULL, NAME("SessionFull")},
    {session_error_quark, SESSION_ERROR_DAMAGED, NAME("SessionDamaged")},
    {plan_error_quark, PLAN_ERROR_NO_CAMERA, NAME("PlanNoCamera")},
    {plan_error_quark, PLAN_ERROR_NO_LAMP, NAME("PlanNoLamp")},
    {plan_error_quark, PLAN_ERROR_NO_LASER, NAME("PlanNoLaser")},
    {plan_error_quark, PLAN_ERROR_LIMITS, NAME("PlanLimits")},
    {plan_error_quark, PLAN_ERROR_BLOCKED, NAME("PlanBlocked")},
    {plan_error_quark, PLAN_ERROR_SIZE, NAME("PlanSize")},
    {rig_error_quark, RIG_ERROR_FORMAT, NAME("RigFormat")},
    {rig_error_quark, RIG_ERROR_VALUE, NAME("RigValue")},
};

void bus_errors_register(void) {
    static gsize once;
    if (!g_once_init_enter(&once))
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++)
        g_dbus_error_register_error(names[i].domain(), names[i].code, names[i].name);
    g_once_init_leave(&once, 1);
}

GError *bus_errors_wrap(GError *error) {
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++)
        if (error->domain == names[i].domain())
            return error;
    GError *wrapped = g_error_new_literal(BUS_ERROR, BUS_ERROR_FAILED, error->message);
    g_error_free(error);
    return wrapped;
}
