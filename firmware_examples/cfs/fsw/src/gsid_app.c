/* Application of NASA's core Flight System (cFE 7 and later) that measures the frequency response of an axis: from blocks of
 * command and rate on the software bus to a telemetry message with the response and its standard deviation. */
#include "gsid_app_msg.h"

#include <math.h>
#include <string.h>

#include "gsid/excitation.h"
#include "gsid/frf.h"

enum { DEPTH = 16, SETTLE = 2 * GSID_APP_PERIOD, GOOD = 8, LOST_MOST = 500 }; /* 500 blocks: 10 s */
enum { EVENT_START = 1, EVENT_ERROR = 2, EVENT_LOST = 3, EVENT_RESPONSE = 4 };

static struct {
    uint32 RunStatus;
    CFE_SB_PipeId_t Pipe;
    GSID_APP_Response_t Response;
    uint32 Next; /* count of the block that is expected */
    bool IsSent;
    gsid_frf Frf;
    uint32_t Line[GSID_APP_LINES];
    gsid_cplx Twiddle[GSID_APP_PERIOD];
    gsid_cplx Memory[GSID_FRF_MEM_SIZE(GSID_APP_LINES, 1) / sizeof(gsid_cplx) + 1];
} App;

static gsid_status InitMeasurement(void) {
    const gsid_frf_cfg cfg = {.n_period = GSID_APP_PERIOD,
                              .n_lines = GSID_APP_LINES,
                              .n_settle = SETTLE,
                              .line = App.Line,
                              .twiddle = App.Twiddle}; /* without u_known: the input is measured */
    uint32_t n_lines;
    gsid_status status = gsid_twiddle_fill(GSID_APP_PERIOD, App.Twiddle);
    status = status ? status : gsid_lines_fill(GSID_GRID_FULL, 1, GSID_APP_LINES, GSID_APP_LINES, App.Line, &n_lines);
    return status ? status : gsid_frf_init(&App.Frf, &cfg, App.Memory, sizeof App.Memory);
}

static CFE_Status_t Init(void) {
    memset(&App, 0, sizeof App);
    App.RunStatus = CFE_ES_RunStatus_APP_RUN;
    CFE_Status_t status = CFE_EVS_Register(NULL, 0, CFE_EVS_EventFilter_BINARY);
    if (status == CFE_SUCCESS) {
        status = CFE_MSG_Init(CFE_MSG_PTR(App.Response.Header), CFE_SB_ValueToMsgId(GSID_APP_RESPONSE_MID),
                              sizeof App.Response);
    }
    if (status == CFE_SUCCESS) {
        status = CFE_SB_CreatePipe(&App.Pipe, DEPTH, "GSID_APP_PIPE");
    }
    if (status == CFE_SUCCESS) {
        status = CFE_SB_Subscribe(CFE_SB_ValueToMsgId(GSID_APP_SAMPLES_MID), App.Pipe);
    }
    if (status != CFE_SUCCESS) {
        return status;
    }
    const gsid_status measurement = InitMeasurement();
    if (measurement != GSID_OK) {
        CFE_EVS_SendEvent(EVENT_ERROR, CFE_EVS_EventType_ERROR, "GSID: %s", gsid_status_str(measurement));
        return CFE_STATUS_EXTERNAL_RESOURCE_FAIL;
    }
    CFE_EVS_SendEvent(EVENT_START, CFE_EVS_EventType_INFORMATION, "GSID: measuring %d lines", GSID_APP_LINES);
    return CFE_SUCCESS;
}

static void Publish(void) {
    static gsid_cplx g[GSID_APP_LINES];
    static gsid_real variance[GSID_APP_LINES];
    const gsid_frf_out out = {.g = g, .var_g = variance};
    const gsid_status status = gsid_frf_result(&App.Frf, &out);
    if (status != GSID_OK) {
        CFE_EVS_SendEvent(EVENT_ERROR, CFE_EVS_EventType_ERROR, "GSID: %s", gsid_status_str(status));
        return;
    }
    App.Response.Periods = App.Frf.n_periods;
    App.Response.Spoiled = App.Frf.n_spoiled;
    for (uint32_t i = 0; i < GSID_APP_LINES; i++) {
        App.Response.Real[i] = (float)g[i].re;
        App.Response.Imaginary[i] = (float)g[i].im;
        App.Response.Sigma[i] = sqrtf((float)variance[i]);
    }
    CFE_SB_TimeStampMsg(CFE_MSG_PTR(App.Response.Header));
    CFE_SB_TransmitMsg(CFE_MSG_PTR(App.Response.Header), true);
    CFE_EVS_SendEvent(EVENT_RESPONSE, CFE_EVS_EventType_INFORMATION, "GSID: response of %u periods",
                      (unsigned)App.Response.Periods);
}

/* Whether a block belongs to the measurement. Samples of lost blocks are skipped, so that the period stays in step with the
 * excitation; block 0 begins a new measurement. */
static bool IsInStep(uint32 count) {
    if (count == 0 && InitMeasurement() == GSID_OK) {
        App.Next = 0;
        App.IsSent = false;
    }
    if (count < App.Next || count - App.Next > LOST_MOST) {
        CFE_EVS_SendEvent(EVENT_LOST, CFE_EVS_EventType_ERROR, "GSID: block %u refused, %u expected", (unsigned)count,
                          (unsigned)App.Next);
        return false;
    }
    if (count > App.Next) {
        CFE_EVS_SendEvent(EVENT_LOST, CFE_EVS_EventType_ERROR, "GSID: %u blocks lost", (unsigned)(count - App.Next));
        gsid_frf_skip(&App.Frf, (count - App.Next) * GSID_APP_BLOCK);
    }
    App.Next = count + 1;
    return true;
}

static void Measure(const GSID_APP_Samples_t *samples) {
    if (!IsInStep(samples->Count)) {
        return;
    }
    for (uint32_t i = 0; i < GSID_APP_BLOCK; i++) {
        const gsid_status status = gsid_frf_step(&App.Frf, samples->Command[i], samples->Rate[i]);
        if (status == GSID_E_NONFINITE) {
            gsid_frf_skip(&App.Frf, 1);
        }
    }
    if (!App.IsSent && App.Frf.n_periods >= GOOD) {
        Publish();
        App.IsSent = true;
    }
}

static void Dispatch(const CFE_SB_Buffer_t *buffer) {
    CFE_SB_MsgId_t id;
    size_t size;
    CFE_MSG_GetMsgId(&buffer->Msg, &id);
    CFE_MSG_GetSize(&buffer->Msg, &size);
    if (CFE_SB_MsgIdToValue(id) != GSID_APP_SAMPLES_MID || size != sizeof(GSID_APP_Samples_t)) {
        CFE_EVS_SendEvent(EVENT_ERROR, CFE_EVS_EventType_ERROR, "GSID: message 0x%x of %u bytes refused",
                          (unsigned)CFE_SB_MsgIdToValue(id), (unsigned)size);
        return;
    }
    Measure((const GSID_APP_Samples_t *)buffer);
}

void GSID_APP_Main(void);

void GSID_APP_Main(void) {
    if (Init() != CFE_SUCCESS) {
        App.RunStatus = CFE_ES_RunStatus_APP_ERROR;
    }
    while (CFE_ES_RunLoop(&App.RunStatus)) {
        CFE_SB_Buffer_t *buffer;
        const CFE_Status_t status = CFE_SB_ReceiveBuffer(&buffer, App.Pipe, CFE_SB_PEND_FOREVER);
        if (status == CFE_SUCCESS) {
            Dispatch(buffer);
        } else {
            CFE_EVS_SendEvent(EVENT_ERROR, CFE_EVS_EventType_ERROR, "GSID: no message, status 0x%08X",
                              (unsigned)status);
            App.RunStatus = CFE_ES_RunStatus_APP_ERROR;
        }
    }
    CFE_ES_ExitApp(App.RunStatus);
}
