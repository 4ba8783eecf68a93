% fit_peers IN OUT: invfreqs (package signal) and fitfrd (package control) on the responses in IN, called by fit_peers.py.
% The delay is divided out by hand, the frequency scaled to 1 at the last line. invfreqs gets as many zeros as
% poles: with one zero less its equations are singular (signal 1.4.3). Times are those inside Octave, the
% least of three runs.
pkg load signal
pkg load control
names = argv();
load(names{1});
w = f_hz(:)' / f_hz(end);
n_seeds = rows(g);
response = zeros(2, n_seeds, columns(g));
stable = zeros(2, n_seeds);
wall_ms = cpu_ms = Inf(2, n_seeds);
for k = 1:n_seeds
    h = g(k, :) .* exp(2j * pi * f_hz(:)' * delay_s);
    for peer = 1:2
        if peer == 1
            job = @() invfreqs(h, w, n_poles, n_poles, 1 ./ var_g(k, :));
        else
            job = @() fitfrd(frd(h, w), n_poles);
        end
        for turn = 1:3
            try
                began = tic(); cpu = cputime();
                if peer == 1
                    [b, a] = job();
                    found = polyval(b, 1j * w) ./ polyval(a, 1j * w);
                    poles = roots(a);
                else
                    found_system = job();
                    found = squeeze(freqresp(found_system, w)).';
                    poles = pole(found_system);
                end
                wall_ms(peer, k) = min(wall_ms(peer, k), 1e3 * toc(began));
                cpu_ms(peer, k) = min(cpu_ms(peer, k), 1e3 * (cputime() - cpu));
                response(peer, k, :) = found .* exp(-2j * pi * f_hz(:)' * delay_s);
                stable(peer, k) = all(real(poles) < 0);
            catch problem
                disp(problem.message)
                response(peer, k, :) = NaN;
            end
        end
    end
end
versions = ["Octave " OCTAVE_VERSION ", signal " pkg("list", "signal"){1}.version ", control " pkg("list", "control"){1}.version];
save("-v7", names{2}, "response", "wall_ms", "cpu_ms", "stable", "versions");
