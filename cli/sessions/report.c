/* report: writes a page about a session, and a description of the session as a research object for
 * data repositories. */
#include "archive.h"
#include "base/data_error.h"
#include "check.h"
#include "common/cli.h"
#include "common/work.h"
#include "history.h"
#include "sessions.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

#define ASYMMETRY_WARN 0.05 /* RMS difference of exchanged directions, relative to the mean */
/* Share of the points of a view that other views refute, because they see something else there. */
#define REFUTED_WARN 0.01

static char *output_option;
static gboolean crate_option, no_verify_option;
static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option, "Page to write", "FILE.html"},
    {"crate", 0, 0, G_OPTION_ARG_NONE, &crate_option,
     "Write DIR/ro-crate-metadata.json, for repositories of research data", NULL},
    {"no-verify", 0, 0, G_OPTION_ARG_NONE, &no_verify_option,
     "Do not compare the checksums of files", NULL},
    {NULL},
};

struct report {
    const char *path;
    OutputFile *page, *crate; /* NULL if not requested */
    struct archive *archive;  /* data of the session; NULL until it was read */
};

/* Adds the findings of `mesorig check`. */
static gboolean add_measurement(struct archive *archive, const struct work *work, GError **error) {
    struct check check = {.path = archive->path,
                          .suspicions = g_ptr_array_new_with_free_func(g_free)};
    const gboolean ok = check_session(work, &check, error);
    const struct energy *energy = ok ? check.energy : NULL;
    if (energy)
        archive_add_check(archive, energy->largest_albedo > 1 ? ARCHIVE_WARNING : ARCHIVE_PASS,
                          "energy", "at most %.3f of a light's energy is reflected",
                          energy->largest_albedo);
    if (energy && energy->pairs > 0)
        archive_add_check(archive,
                          energy->asymmetry > ASYMMETRY_WARN ? ARCHIVE_WARNING : ARCHIVE_PASS,
                          "reciprocity", "%.2f %% RMS between exchanged directions, %d pairs",
                          100 * energy->asymmetry, energy->pairs);
    if (ok && check.has_mdf && check.mdf.seen > 0) {
        const double refuted = (double)check.mdf.refuted / (double)check.mdf.seen;
        archive_add_check(archive, refuted > REFUTED_WARN ? ARCHIVE_WARNING : ARCHIVE_PASS,
                          "surface", "%.2f %% of what a view sees is refuted by other views",
                          100 * refuted);
    }
    if (ok && check.has_mdf && check.mdf.lines.found > 0)
        archive_add_check(
            archive, check.mdf.lines.disagree ? ARCHIVE_WARNING : ARCHIVE_PASS, "laser",
            "%d of %d laser lines around the sample contradict the calibration, by %+.4f° at most",
            check.mdf.lines.disagree, check.mdf.lines.found, check.mdf.lines.worst_deg);
    for (guint i = 0; ok && i < check.suspicions->len; i++)
        archive_add_check(archive, ARCHIVE_FAILURE, "suspicion", "%s",
                          (char *)check.suspicions->pdata[i]);
    check_clear(&check);
    return ok;
}

static gboolean work_report(const struct work *work, gpointer data, GError **error) {
    struct report *report = data;
    g_autoptr(Archive) archive = archive_read(report->path, !no_verify_option, work, error);
    if (!archive || (output_option && !archive_add_pictures(archive, work, error)))
        return FALSE;
    g_autoptr(GError) failed = NULL;
    if (archive->products->len > 0 && !add_measurement(archive, work, &failed)) {
        if (g_error_matches(failed, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
            g_propagate_error(error, g_steal_pointer(&failed));
            return FALSE;
        }
        archive_add_check(archive, ARCHIVE_FAILURE, "measurement", "%s", failed->message);
    }
    report->archive = g_steal_pointer(&archive);
    return TRUE;
}

/* Returns the drawing of `mesorig info --history` as an <svg> element. Returns NULL if nothing
 * was captured or the drawing fails. */
static char *history(const char *path, GError **error) {
    g_autofree char *file = NULL;
    char *svg = NULL;
    const int descriptor = g_file_open_tmp("mesorig-XXXXXX.svg", &file, error);
    if (descriptor < 0)
        return NULL;
    close(descriptor);
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    if (session && history_draw(session, file, error))
        g_file_get_contents(file, &svg, NULL, error);
    g_unlink(file);
    const char *begin = svg ? g_strstr_len(svg, -1, "<svg") : NULL;
    char *ret = begin ? g_strdup(begin) : NULL;
    g_free(svg);
    return ret;
}

/* Checks the outputs before the work begins. */
static gboolean choose_files(struct report *report, GError **error) {
    g_autofree char *path = g_build_filename(report->path, "ro-crate-metadata.json", NULL);
    if (output_option && !(report->page = cli_output(output_option, "report", error)))
        return FALSE;
    return !crate_option || (report->crate = cli_output(path, "crate", error));
}

static gboolean write_files(const struct report *report, GError **error) {
    const struct archive *archive = report->archive;
    if (report->page) {
        /* Imported sessions have no history. */
        g_autofree char *drawing = history(archive->path, NULL);
        g_autofree char *page = archive_page(archive, drawing);
        if (!output_file_put(report->page, page, strlen(page), error))
            return FALSE;
    }
    if (!report->crate)
        return TRUE;
    g_autofree char *crate = archive_crate(archive);
    return output_file_put(report->crate, crate, strlen(crate), error);
}

static int run(const struct call *call, GError **error) {
    struct report report = {.path = call->arguments[0]};
    if (!output_option && !crate_option)
        return cli_usage(call->command, "there is nothing to write: give -o FILE.html or --crate");
    const gboolean ok = choose_files(&report, error) &&
                        cli_work_run(work_report, &report, NULL, error) &&
                        write_files(&report, error);
    g_autoptr(OutputFile) page_file = report.page, crate_file = report.crate;
    g_autoptr(Archive) archive = report.archive;
    if (!ok)
        return CLI_FAILED;
    Record *to = call->record;
    const char *verdict = archive_verdict_name(archive_verdict(archive));
    record_add(to, "%s{session} %s{file}", archive->path, output_option);
    record_boolean(to, "crate", crate_option);
    record_string(to, "verdict", verdict);
    record_begin_list(to, "checks");
    for (guint i = 0; i < archive->checks->len; i++) {
        const struct archive_check *check = archive->checks->pdata[i];
        record_begin(to, NULL);
        record_say_if(to, check->verdict != ARCHIVE_PASS, "%-8s{verdict} %s{name}: %s{said}\n",
                      archive_verdict_name(check->verdict), check->name, check->said);
        record_end(to);
    }
    record_end(to);
    record_say(to, "%s: %u checks, all together: %s\n", archive->name, archive->checks->len,
               verdict);
    if (page_file) {
        record_say(to, "%s: open it in a browser\n", output_option);
        cli_tell_output(to, page_file);
    }
    if (crate_file)
        record_say(to, "%s/ro-crate-metadata.json: the folder is ready for a data repository\n",
                   archive->path);
    return CLI_DONE;
}

const struct command cli_report = {
    .name = "report",
    .arguments = "DIR -o FILE.html",
    .examples = "  mesorig report weave.session -o weave.html\n",
    .help = "Write a report of a session, and metadata for archives of data.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
