/* Detects that a rig file and a session file were exchanged. */
#include "plan.h"

#include <gio/gio.h>

#include "base/config.h"

/* Returns whether the file has the section [one] and not the section [other]. Returns FALSE if the
 * file cannot be read; the code that needs the file reports that later. */
static gboolean has_only(const char *path, const char *one, const char *other) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    g_autoptr(Config) config = config_load_checked(path, mistakes);
    return config && config_find(config, one, NULL) && !config_find(config, other, NULL);
}

gboolean plan_check_order(const char *rig_path, const char *session_path, GError **error) {
    const gboolean session_first = has_only(rig_path, "session", "rig");
    const gboolean rig_second = has_only(session_path, "rig", "session");
    if (session_first)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "%s is a session file%s%s%s: give RIG before SESSION", rig_path,
                    rig_second ? ", and " : "", rig_second ? session_path : "",
                    rig_second ? " is a rig file" : "");
    else if (rig_second)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "%s is a rig file: give RIG before SESSION, a file with a section [session]",
                    session_path);
    return !session_first && !rig_second;
}
