#include "web_hands.h"

#include <libsoup/soup.h>

#define MIN_LEASE_S 0.1

static void set_light(const struct web_task *task, const char *method, gboolean on) {
    double for_s = 0;
    if (!g_utf8_validate(task->name, -1, NULL))
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "the name of this light is not UTF-8: /api/v1/state lists the lights");
    else if (!on || web_task_number(task, "for_s", MIN_LEASE_S, WEB_HANDS_MAX_LEASE_S, &for_s))
        web_task_call(task, method, g_variant_new("(sbd)", task->name, on, for_s), NULL);
}

void web_hands_lamp_on(const struct web_task *task) {
    set_light(task, "SetLamp", TRUE);
}

void web_hands_laser_on(const struct web_task *task) {
    set_light(task, "SetLaser", TRUE);
}

void web_hands_lamp_off(const struct web_task *task) {
    set_light(task, "SetLamp", FALSE);
}

void web_hands_laser_off(const struct web_task *task) {
    set_light(task, "SetLaser", FALSE);
}
