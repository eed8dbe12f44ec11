#include "watchdog.h"

#include <math.h>

/* Shorter than the deadline of the class, so that the error of the line is reported. */
#define DEADLINE_MS 1500

int modbus_watchdog_value(const struct modbus_watchdog *watchdog) {
    return (int)lround(watchdog->after_s * watchdog->scale);
}

double modbus_watchdog_s(const struct modbus_watchdog *watchdog) {
    return modbus_watchdog_value(watchdog) / watchdog->scale;
}

gint64 modbus_watchdog_period_us(const struct modbus_watchdog *watchdog) {
    return (gint64)(modbus_watchdog_s(watchdog) * 1e6 / 3);
}

void modbus_watchdog_check(const struct modbus_watchdog *watchdog, const struct modbus_link *link,
                           const struct config_section *section, int max, Mistakes *mistakes) {
    /* The time in s that one lost answer takes (line.c): timeout_ms, and late_ms of silence
     * twice. */
    double lapse_s = (link->timeout_ms + 2 * link->late_ms) / 1000;
    double written = watchdog->after_s * watchdog->scale, min_s = 1.5 * lapse_s;
    if (written < 0.5 || round(written) > max)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "watchdog_scale",
                       "watchdog_after_s × watchdog_scale, %g × %g, is not a number from 1 to %d",
                       watchdog->after_s, watchdog->scale, max);
    else if (modbus_watchdog_s(watchdog) < min_s)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "watchdog_after_s",
                       "%g s is too short, because a lost answer takes %g s (timeout_ms and twice "
                       "late_ms); write %g or more",
                       modbus_watchdog_s(watchdog), lapse_s, min_s);
}

gboolean modbus_watchdog_arm(const struct modbus_watchdog *watchdog, ModbusBus *bus,
                             const struct modbus_link *link, GError **error) {
    guint16 value = (guint16)modbus_watchdog_value(watchdog);
    struct modbus_job job = {0};
    if (watchdog->address < 0)
        return TRUE;
    struct modbus_request *request =
        modbus_job_add(&job, MODBUS_READ_HOLDING, watchdog->address, 1);
    gboolean ok = modbus_bus_do(bus, link, &job, DEADLINE_MS, error);
    if (ok && request->values[0] != value) {
        *request = (struct modbus_request){MODBUS_WRITE_HOLDING, watchdog->address, 1,
                                           .values = {value}, .verify = TRUE};
        ok = modbus_bus_do(bus, link, &job, DEADLINE_MS, error);
    }
    if (!ok)
        g_prefix_error(error, "watchdog_register: ");
    return ok;
}

void modbus_watchdog_add_check(const struct modbus_watchdog *watchdog, struct modbus_job *job) {
    if (watchdog->address < 0)
        return;
    struct modbus_request *request = modbus_job_add(job, MODBUS_READ_HOLDING, watchdog->address, 1);
    request->values[0] = (guint16)modbus_watchdog_value(watchdog);
    request->verify = TRUE;
}
