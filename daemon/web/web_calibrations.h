/*
 * The tasks of calibrations (web_task.h), which are computed step by step from sessions in the
 * folder. The results of the steps of the calibration "rig" are in the directory
 * FOLDER/rig.calibrating, its draft:
 *
 *   STEP.calibration   the calibration after a step
 *   STEP.html          a page with the pictures of the step and what was found in them
 *   STEP.txt           what mesorig has printed in the step
 *   failed.html        the page of the last step, if it has failed
 *   board.pdf          a board to print
 *   report.html        the report of the calibration
 *
 * Each step starts from the result of the step before it. A step that is repeated replaces its
 * result only when it has succeeded, and then removes the results of later steps, which were based
 * on the old one. Nothing replaces FOLDER/rig.calibration, which web_calibrations_keep() makes of
 * the draft. A draft is kept if the server ends.
 */
#pragma once

#include "web_task.h"

#define WEB_CALIBRATIONS_SESSIONS 16 /* maximum number of sessions of a step */

WebCalibrations *web_calibrations_new(void);
/* The child must have been freed before. NULL is ignored. */
void web_calibrations_free(WebCalibrations *calibrations);

/* Answers {"folder", "targets": [names], "calibrations": [{"name", "bytes", "changed"}], "drafts":
 * [{"name", "steps": [{"step", "text"}], "files": [names]}], "working": {"name", "step"} or null,
 * "failed": {"name", "step", "why"} or null}. Targets are files with the line [target]. */
void web_calibrations_list(const struct web_task *task);

/* Begins a step, and answers {}. The query names the step: step=board, cameras, lights, laser,
 * radiometry or report. sessions=A/B gives the names of the sessions that show the target. The keys
 * board, target and reflectance of the query have the same values as the options of `mesorig
 * calibrate` with these names. */
void web_calibrations_find(const struct web_task *task);

/* Makes FOLDER/NAME.calibration from the result of the last step. Refuses if this file exists. */
void web_calibrations_keep(const struct web_task *task);

/* Answers with a page of the draft. The query names the page: step=cameras, lights, laser,
 * radiometry, report or failed. The headers of the answer allow the scripts of the page only to
 * draw. */
void web_calibrations_page(const struct web_task *task);
void web_calibrations_board(const struct web_task *task); /* the board as PDF */
