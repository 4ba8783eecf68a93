"""Constants of the diagnosis from records, each with its unit and the reason for its value."""

from __future__ import annotations

from dataclasses import dataclass

from gsid.diagnosis.joint_bias import NOISE_LEFT
from gsid.diagnosis.missing_torque.settings import DEFAULTS as OF_SEARCH
from gsid.diagnosis.missing_torque.settings import SearchSettings


@dataclass(frozen=True)
class DecisionSettings:
    """Constants of `gsid.diagnosis.from_records`.

    Attributes
    ----------
    search : SearchSettings
        Constants of the first stage.
    strayed : float
        Factor between a given value and that of a fit with a missing linear effect from which the fit may be
        in a wrong minimum: given values may be 30 % off, and one whose place was taken moves by far more.
    largest_residue : float
        Of a mode of a given model, over its given residue or over the body. With 100 a mode took the place of
        the body (seed 5333); two modes that cancelled each other had 6000 (seed 5332).
    low_mode : float
        Modes below this many lowest lines are merged into a free or viscous body, or left out: a low mode of
        a fit that lacks a law is a spring, or the law itself.
    merged_cost : float
        Largest ratio of the costs with and without merging: a mode that is a resonance of the axis lowers the
        cost of the linear part by far more than one that stands for a law.
    much_left : float
        Cost per degree of freedom of the best law above which its error is larger than noise: another linear
        stack is tried, and the fits by simulation are judged with the weights of what the best one leaves.
        Without a given model play is tried: it leaves 7 times the power of noise where the load is light.
    less_left : float
        Largest share of this cost that the best law leaves beside the other stack.
    ringing : float
        Noise of a line over what the fits take for it, if all of it excites a resonance of the axis, above
        which the line is left out. Below it, such a line adds at most this to the cost of some hundred lines.
    loop_error : float
        Largest rms of the command that a controller found from reference and output leaves, over its rms:
        more is another controller.
    corner : float
        Corner frequency of a spring or a damping that the start did not find, in lowest lines: far below them
        it does not show.
    lag_share : float
        Start of a lag that the start did not find, in samples.
    vanished, vanished_delay : float
        Corner [lowest lines] or lag [samples], and delay [samples], below which an element is dropped before
        a simulation. A short lag makes it stiff, and a delay does nearly the same. A delay below its limit
        changes no line by 1e-3.
    linear_rounds : int
        Linear effects that are added to the stack before a law is judged: no development trial needed more
        than two.
    linear_fall : float
        Share of the kept-out misfit that a linear effect has to explain to be added.
    significant : float
        Standard deviations below which an element may be zero.
    needed : float
        Rise of the cost at which an element is needed all the same: about ln n for one parameter.
    effects_most : int
        Effects that a given model may lack: each needs rounds of its own.
    share_of_next : float
        Share of the kept-out misfit that a law has to explain for a search beside it. Of two missing effects
        of similar size each explains about half; a quarter leaves room for a third one.
    chance : float
        Fall of the cost above ln n for each parameter that the best of many laws has by chance.
    structure_rounds : int
        Repetitions of the start without the law's part of the output: the second changes nothing in most
        trials.
    time_s : float
        Default budget [s]: a longer diagnosis is unusual, and its state then is the answer.
    slice_steps : int
        Iterations of a fit by simulation between two looks at the clock and at the rival's cost.
    slices, slices_of_rivals : int
        Most slices of the winner's fit and of the others: most fits of the trials need three. The first slice
        is one iteration: a law that cannot catch up often shows it there.
    moves_most, moves_of_fit, moves_of_play : float
        Most work of the fits by simulation of a round, of one fit, and of play between motor and load beside
        all its structures, which is tried last, and again with a hidden mode, in moves of one column
        (`gsid_plant_cfg.moves_left`). A move takes 30 to 60 ns on the axes of the trials, up to 400 ns beside
        a stop with periods of 60 samples:
        they bound the time without a clock. Most fits of the trials take 2e6 to 2e8, the hysteretic benchmark
        2e7; stiff hysteresis and wide stops took up to 7e9.
    rival_share : float
        Least share kept out, by the first stage, of a law that is fitted by simulation: a law that explains
        less cannot catch up.
    rivals : int
        Laws of other families that are fitted by simulation.
    members : int
        Further laws of the winner's family that are fitted by simulation.
    stalled, stalled_share : float
        A fit is given up if a slice lowers its cost by less [noise units], or by less than a share of it.
    step_left, step_share : float
        Fall of the cost that is predicted for a further step [noise units], or as a share of the cost, below
        which a fit has converged: noise varies the cost by more, and an error of the model hides the share.
    unsettled : float
        Largest change of a simulated output from period to period, over its rms.
    hopeless : float
        A rival is given up if a slice lowers its cost by less than this share of what it has to catch up.
    p_least : float
        p-value of what the linear part leaves, below which something is missing though no law explains it. A
        structure that was selected from the data leaves a little more than noise.
    p_left : float
        p-value below which what a law leaves depends on a coordinate, though its cost is that of noise: one
        of a thousand right laws is then the nearest instead of named.
    adequate : float
        Cost per degree of freedom up to which only noise is left, set on the development trials. The noise is
        estimated from few periods, so that a complete model may leave more than 1.
    p_adequate : float
        p-value of a fit from which it leaves only noise though its cost is above that limit, as with three
        periods: the usual level of a test.
    copies_most : int
        Copies of one linear effect that may be named together, beside those of the given model. A delay that
        the catalogue lacked was called a missing mode after three of them.
    p_copies : float
        p-value of what two copies leave, below which they are the nearest: they may be the begin of a series.
    null_gain : float
        Drop of the cost that any law needs beside ln n per parameter, by simulation. Over its steps or cycles
        a law has thousands of shapes: among 100 nulls the best one reached 13, 16 and 20.
    null_cost, null_spread : float
        Cost per degree of freedom of the linear part up to which nothing may be missing: that of the first
        stage, or 1 and so many standard deviations where the data are few.
    named_share, named_margin : float
        Least share of the misfit explained, kept out, and least ratio of what the best rival leaves, both by
        simulation, for a name where more than noise is left: those of the first stage.
    linear_share : float
        Least share of a linear effect: nothing but noise should be left of it.
    named_lead : float
        Drop of the cost against the best rival that is as good as the margin where only noise is left: a weak
        effect has no large ratio.
    linear_drop : float
        The same of a linear effect against nothing missing. Chance reaches 30, with the three parameters of a
        mode at the best of some hundred frequencies. Also of each law beside the line where it explains most,
        if a disturbance at a fixed frequency may have caused that.
    linear_odds : float
        Least odds of a linear effect against other linear effects, and against laws, where only noise is
        left: those of the linear structure. Its rivals are complete, and were fitted as well.
    nearest_share, nearest_scatter : float
        Least share, and largest scatter of the coefficient, of a nearest law: a law that explains less than
        half is not the main effect.
    nearest_error_share : float
        Least share of a nearest law that leaves more than noise, from the records alone. Of eleven such
        laws in the trials of two studies ten were wrong, with shares of 0.50 to 0.80; the right one had 0.96.
    periods_least : int
        Fewest periods of a single record for a name: its thirds have two periods each.
    clear_misfit : float
        Cost per degree of freedom of the linear part above which fewer periods are enough. Thirds of the
        lines are left out then; the periods only show how large the noise is, and the misfit is far above it.
        The same of the cost that play has to fall below, above which play is tried though a joint does not
        improve the response.
    zeta_of_mode : float
        Damping ratio from which a mode may stand for something else: the modes of stiff structures have 0.003
        to 0.05, those that stood for a joint with play 0.2 to 1.6, one that stood for a lag 0.3.
    many_shapes : int
        Parameters from which a law has laws of other families as limits.
    spare : int
        Numbers of a line beyond the parameters of a law: with fewer, a law fits a disturbance by chance.
    nonlinear_share : float
        Least share of the fall of the cost that a nonlinear law has to explain beside any change of the
        linear response: 33 right laws with small drops had 0.43 and more; Bouc-Wen friction in place of a
        creep had less than none.
    far_structure : float
        Cost of a structure for play, over that of the best one, from which it is tried last. Without play
        those that turned out right cost up to 7 times as much as the linear part.
    named_scatter, scatter_errors : float
        Largest scatter of the law's coefficient over realisations, or in standard errors.
    shape_scatter : float
        The same for laws of three parameters and more that leave only noise: where the coefficient varies by
        more than itself, the shapes make up for it, as those of Bouc and Wen do for creep.
    worse : float
        Rise of the cost [noise units; over the cost per degree of freedom where that is above 1] above which
        a law is worse than the best of its family.
    clearly_worse : float
        Rise of the cost up to which a simpler law of the family that leaves only noise stays in the group:
        two more parameters reach 12 in one of 400 cases (chi-square), and a Coulomb friction was named
        Stribeck friction at 13.
    different : float
        Least difference of the torque of a larger law from that of the best one, over its rms or its peak,
        for a shape that matters: a friction that is twice as large at low speed differs by 0.2 to 0.4.
    seldom : float
        Share of the time during which the difference over the peak is exceeded: a Stribeck friction that was
        lost was as likely as one of 1.6 times the Coulomb friction below a 37th of the largest rate, which
        differs by 8 % of the rms, and during 2 % of the time by 22 % of the peak.
    peak_most : float
        Largest peak of such a torque, over that of the best law: more friction at rest is unusual.
    member_ratio : float
        What a simpler law of the family has to leave, kept out, over what the best leaves, to be worse where
        a model error is left.
    worse_share : float
        The same as a share of the cost that is left: where a model error is left, a smaller difference does
        not decide.
    """

    search: SearchSettings = OF_SEARCH
    strayed: float = 3.0
    largest_residue: float = 10.0
    low_mode: float = 4.0
    merged_cost: float = 10.0
    much_left: float = SearchSettings.model_error
    less_left: float = 0.5
    ringing: float = 4.0
    loop_error: float = 0.02
    corner: float = 0.5
    lag_share: float = 0.5
    vanished: float = 0.02
    vanished_delay: float = 3e-4
    linear_rounds: int = 3
    linear_fall: float = 0.25
    significant: float = 3.0
    needed: float = 8.0
    effects_most: int = 3
    share_of_next: float = 0.25
    chance: float = 10.0
    structure_rounds: int = 2
    time_s: float = 60.0
    slice_steps: int = 4
    slices: int = 10
    slices_of_rivals: int = 4
    moves_most: float = 6e8
    moves_of_fit: float = 2.5e8
    moves_of_play: float = 3e8
    rival_share: float = 0.25
    rivals: int = 1
    members: int = 2
    stalled: float = 0.5
    stalled_share: float = 1e-4
    step_left: float = 1.0
    step_share: float = 1e-3
    unsettled: float = 1e-3
    hopeless: float = 0.25
    p_least: float = 1e-4
    p_left: float = 1e-3
    adequate: float = NOISE_LEFT
    p_adequate: float = 0.05
    copies_most: int = 2
    p_copies: float = 0.01
    null_gain: float = 25.0
    null_cost: float = SearchSettings.null_cost
    null_spread: float = 3.0
    named_share: float = SearchSettings.named_share
    named_margin: float = SearchSettings.named_margin
    linear_share: float = SearchSettings.exact_share
    named_lead: float = SearchSettings.named_lead
    linear_drop: float = 40.0
    linear_odds: float = 1000.0
    nearest_share: float = SearchSettings.nearest_share
    nearest_scatter: float = SearchSettings.nearest_scatter
    nearest_error_share: float = 0.85
    periods_least: int = SearchSettings.periods_least
    clear_misfit: float = 10.0
    zeta_of_mode: float = 0.1
    many_shapes: int = 3
    spare: int = 2
    nonlinear_share: float = 0.1
    far_structure: float = 7.0
    named_scatter: float = SearchSettings.named_scatter
    scatter_errors: float = SearchSettings.scatter_errors
    shape_scatter: float = 1.0
    worse: float = 12.0
    clearly_worse: float = 25.0
    different: float = 0.2
    seldom: float = 0.02
    peak_most: float = 2.0
    member_ratio: float = 2.0
    worse_share: float = 0.1


DEFAULTS = DecisionSettings()
