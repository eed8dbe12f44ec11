#include "web_tasks.h"

#include "web_calibrations.h"
#include "web_files.h"
#include "web_hands.h"
#include "web_products.h"
#include "web_queue.h"
#include "web_snaps.h"

#include <string.h>

static const struct web_task_path paths[] = {
    {"files", NULL, FALSE, web_files_list},
    {"files/", "/plan", TRUE, web_files_plan},
    {"files/", "/start", TRUE, web_files_start},
    {"files/", "/queue", TRUE, web_files_queue},
    {"sessions", NULL, FALSE, web_files_sessions},
    {"sessions/", "/resume", TRUE, web_files_resume},
    {"sessions/", "/make", TRUE, web_products_make},
    {"sessions/", "/report.html", FALSE, web_products_report},
    {"sessions/", "/page.html", FALSE, web_products_page},
    {"sessions/", "/material.glb", FALSE, web_products_gltf},
    {"products", NULL, FALSE, web_products_list},
    {"calibrations", NULL, FALSE, web_calibrations_list},
    {"calibrations/", "/find", TRUE, web_calibrations_find},
    {"calibrations/", "/keep", TRUE, web_calibrations_keep},
    {"calibrations/", "/page.html", FALSE, web_calibrations_page},
    {"calibrations/", "/board.pdf", FALSE, web_calibrations_board},
    {"queue/pause", NULL, TRUE, web_queue_pause},
    {"queue/resume", NULL, TRUE, web_queue_resume},
    {"queue/", "/remove", TRUE, web_queue_remove},
    {"queue/", "/move", TRUE, web_queue_move},
    {"cameras/", "/snap", TRUE, web_snaps_take},
    {"cameras/", "/snap.png", FALSE, web_snaps_png},
    {"cameras/", "/pixels.png", FALSE, web_snaps_pixels},
    {"lamps/", "/on", TRUE, web_hands_lamp_on},
    {"lamps/", "/off", TRUE, web_hands_lamp_off},
    {"lasers/", "/on", TRUE, web_hands_laser_on},
    {"lasers/", "/off", TRUE, web_hands_laser_off},
};

const struct web_task_path *web_tasks_find(const char *path, char **ret_name) {
    *ret_name = NULL;
    for (gsize i = 0; i < G_N_ELEMENTS(paths); i++) {
        const struct web_task_path *at = &paths[i];
        const gsize before = strlen(at->before), after = at->after ? strlen(at->after) : 0;
        const gsize n = strlen(path);
        if (!at->after ? strcmp(path, at->before) != 0
                       : n < before + after || !g_str_has_prefix(path, at->before) ||
                             !g_str_has_suffix(path, at->after))
            continue;
        *ret_name = g_strndup(path + before, n - before - after);
        return at;
    }
    return NULL;
}
