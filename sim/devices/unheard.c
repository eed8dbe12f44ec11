#include "unheard.h"

gboolean sim_unheard_is_dead(const struct sim_unheard *fault, const Clock *clock) {
    return clock_now_us(clock) < fault->dead_until_us;
}

gboolean sim_unheard_obeys(struct sim_unheard *fault, const Clock *clock, gboolean *ret_answers) {
    *ret_answers = FALSE;
    if (sim_unheard_is_dead(fault, clock))
        return FALSE;
    *ret_answers = ++fault->n_commands != fault->nth;
    if (!*ret_answers)
        fault->dead_until_us = clock_now_us(clock) + (gint64)(fault->dead_s * G_USEC_PER_SEC);
    return TRUE;
}

GError *sim_unheard_error(const struct device *device) {
    return device_error_new(DEVICE_ERROR_TIMEOUT, device->who,
                            "no answer within %d ms" ERROR_ADVICE
                            "check the device's power and cable",
                            SIM_UNHEARD_US / 1000);
}
