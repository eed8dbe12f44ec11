#include "find_guardian.h"

#include <signal.h>

pid_t find_guardian(const char *rig) {
    g_autoptr(GDir) proc = g_dir_open("/proc", 0, NULL);
    const char *name;
    while ((name = g_dir_read_name(proc))) {
        g_autofree char *path = g_build_filename("/proc", name, "cmdline", NULL);
        g_autofree char *text = NULL;
        gsize length = 0;
        if (!g_ascii_isdigit(*name) || !g_file_get_contents(path, &text, &length, NULL))
            continue;
        g_autofree char *wanted = g_strdup_printf("mesorigd%c--guardian%c%s", 1, 1, rig);
        for (gsize i = 0; i + 1 < length; i++)
            text[i] = text[i] ? text[i] : 1;
        if (length > 0 && strncmp(text, wanted, length) == 0)
            return (pid_t)g_ascii_strtoll(name, NULL, 10);
    }
    return 0;
}

void end_guardian(const char *rig) {
    for (pid_t guardian; (guardian = find_guardian(rig)) != 0; g_usleep(10000))
        kill(guardian, SIGKILL);
}
