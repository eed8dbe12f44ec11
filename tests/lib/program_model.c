#include "program_model.h"

#include "process.h"
#include "text_file.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>

char *program_model_section(const char *class_name, const char *folder, int start_s,
                            const char *keys) {
    return g_strdup_printf("[%s test]\ndriver = program-%s\nprogram = " PROGRAM_PYTHON
                           "\narguments = " PROGRAM_MODEL ";%s;%s\nstart_s = %d\n%s",
                           class_name, class_name, class_name, folder, start_s, keys);
}

void program_model_fail(const char *folder, const char *fault) {
    g_autofree char *path = g_build_filename(folder, "fault", NULL);
    if (*fault)
        text_file_write(folder, "fault", fault);
    else
        g_unlink(path);
}

void program_model_conformance_fail(gpointer folder, enum conformance_fault fault) {
    program_model_fail(folder, fault == CONFORMANCE_WELL  ? ""
                               : fault == CONFORMANCE_CUT ? "cut"
                                                          : "unanswered");
}

char *program_model_read(const char *folder, const char *name) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    return g_file_test(path, G_FILE_TEST_EXISTS) ? text_file_read(path) : g_strdup("");
}

int program_model_asked(const char *folder, const char *method) {
    g_autofree char *log = program_model_read(folder, "log");
    g_autofree char *line = g_strdup_printf(" %s\n", method);
    g_auto(GStrv) parts = g_strsplit(log, line, -1);
    return (int)g_strv_length(parts) - (*parts != NULL);
}

int program_model_processes(const char *folder) {
    g_autoptr(GArray) found = process_find("cmdline", folder);
    return (int)found->len;
}

void program_model_kill(const char *folder) {
    g_autofree char *log = program_model_read(folder, "log");
    g_strchomp(log);
    const char *last = strrchr(log, '\n');
    const gint64 pid = g_ascii_strtoll(last ? last + 1 : log, NULL, 10);
    g_assert_cmpint(pid, >, 1);
    g_assert_cmpint(kill((pid_t)pid, SIGKILL), ==, 0);
}
