#include "rig_daemon.h"

#include "find_guardian.h"
#include "process.h"
#include "text_file.h"

#define MESORIGD BUILD_DIR "/bin/mesorigd"

void rig_daemon_begin(struct rig_daemon *run, const char *folder, const char *rig) {
    *run = (struct rig_daemon){.rig = g_build_filename(folder, "rig.conf", NULL),
                               .log = g_build_filename(folder, "log", NULL),
                               .address = g_strdup_printf("unix:path=%s/bus", folder)};
    text_file_write(folder, "rig.conf", rig);
    run->daemon =
        process_start_ready(G_SUBPROCESS_FLAGS_NONE, run->log,
                            (const char *[]){"/bin/sh", "-c", "exec \"$@\" >&2", "sh", MESORIGD,
                                             "--listen", run->address, "--rig", run->rig, NULL});
    g_assert_cmpint(find_guardian(run->rig), !=, 0);
}

void rig_daemon_end(struct rig_daemon *run) {
    g_subprocess_force_exit(run->daemon);
    g_subprocess_wait(run->daemon, NULL, NULL);
    end_guardian(run->rig);
    g_object_unref(run->daemon);
    g_free(run->rig);
    g_free(run->log);
    g_free(run->address);
}
