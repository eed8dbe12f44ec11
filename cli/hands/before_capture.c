#include "before_capture.h"

#include <gio/gio.h>
#include <string.h>

#include "auto_exposure.h"
#include "capture/capture_calibration.h"
#include "guard.h"
#include "rig/devices.h"

static gboolean nothing_is_done(const struct calibration *known) {
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        if (known->parts[i].done)
            return FALSE;
    return TRUE;
}

static gboolean take_test_shots(Link *link, const struct before_capture *what,
                                const struct session_conf *conf, const struct rig *rig,
                                GError **error) {
    g_autofree char *line = NULL;
    g_autoptr(Calibration) known = capture_calibration_for(what->rig_path, rig, what->calibration,
                                                           what->calibration_text, &line, error);
    int n = 0;
    g_autoptr(GPtrArray) warnings = known ? guard_try(link, conf, rig, known, &n, error) : NULL;
    if (!warnings) {
        g_prefix_error(error, "test shots before the capture: ");
        return FALSE;
    }
    for (guint i = 0; i < warnings->len; i++)
        g_printerr("mesorig: warning: %s\n", (char *)warnings->pdata[i]);
    if (warnings->len > 0 && what->ret_uncalibrated && nothing_is_done(known))
        *what->ret_uncalibrated = TRUE;
    if (warnings->len > 0 && !what->yes)
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_FAILED,
            "the check before the capture (%d test shots) gave %u warning%s, so the capture "
            "was not begun; do what the warnings say, or --yes begins it nevertheless",
            n, warnings->len, warnings->len == 1 ? "" : "s");
    return warnings->len == 0 || what->yes;
}

/* Chooses the exposures that are "auto". Before a device moves, the daemon checks the session file
 * and reports its errors. */
static gboolean choose(Link *link, const struct before_capture *what, struct session_conf *conf,
                       char **ret_chosen, GError **error) {
    gboolean ok = FALSE;
    g_autofree char *text = NULL;
    g_autoptr(GVariant) plan = NULL;
    g_auto(GVariantDict) options;
    g_variant_dict_init(&options, NULL);
    if (what->session_text)
        g_variant_dict_insert(&options, "session_text", "s", what->session_text);
    else if (!link_add_text(link, &options, "session_text", what->session, error))
        return FALSE;
    if (!bus_rig1_call_validate_sync(link_rig(link), what->session, "",
                                     g_variant_dict_end(&options), &ok, &text, &plan, NULL, error))
        return FALSE;
    if (!ok) {
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_FAILED, text);
        return FALSE;
    }
    *ret_chosen = auto_exposure_choose(link, conf, what->rig_path, error);
    return *ret_chosen && session_conf_choose(conf, *ret_chosen, error);
}

gboolean before_capture(Link *link, const struct before_capture *what, char **ret_chosen,
                        GError **error) {
    g_auto(SessionConf) conf = {0};
    struct rig rig;
    *ret_chosen = NULL;
    /* Handle the property changes that the daemon has sent since it opened the rig. */
    while (g_main_context_iteration(NULL, FALSE))
        ;
    const char *state = bus_rig1_get_state(link_rig(link));
    const gboolean free_now = g_strcmp0(state, "idle") == 0 || g_strcmp0(state, "done") == 0 ||
                              g_strcmp0(state, "aborted") == 0;
    const gboolean read = what->session_text
                              ? session_conf_parse(&conf, what->session_text, what->session, NULL)
                              : session_conf_load(&conf, what->session, NULL);
    if (!free_now || !read || !devices_read_geometry(what->rig_path, &rig, NULL))
        return TRUE;
    if (!session_conf_check_chosen(&conf, NULL) && !choose(link, what, &conf, ret_chosen, error))
        return FALSE;
    return !guard_is_worth_it(&conf, &rig) || take_test_shots(link, what, &conf, &rig, error);
}
