"""What a type checker makes of the public functions: checked by `make lint`, never run."""

from typing import assert_type

import gsid

record = gsid.read_record("record.csv")
assert_type(record, gsid.Record)
assert_type(gsid.cut(record, 1.0, 2.0), gsid.Record)

response = gsid.frf(record)
assert_type(response, gsid.Frf)
assert_type(gsid.spectra(record), gsid.Spectra)
assert_type(gsid.noise(record), gsid.Noise)
assert_type(gsid.distortion([record, record]), gsid.Distortion)

rational = gsid.fit(response, "4/3")
assert_type(rational, gsid.RationalModel)
assert_type(gsid.select_order(response), gsid.OrderChoice)

experiments = [gsid.read_mimo_record("experiment.csv", ["u1", "u2"], ["y1", "y2"])]
assert_type(experiments, list[gsid.MimoRecord])
assert_type(gsid.frf_mimo(experiments), gsid.MimoFrf)
assert_type(gsid.fit_mimo(gsid.frf_mimo(experiments), "8/8"), gsid.MimoModel)
assert_type(gsid.distortion_mimo(experiments), gsid.MimoDistortion)
matrix = gsid.MimoModel.load("matrix.json")
assert_type(gsid.compare_mimo(matrix, experiments), gsid.MimoComparison)

model = gsid.load_model("model.json")
assert_type(model, gsid.RationalModel | gsid.PiecewiseModel | gsid.MimoModel | gsid.PlantModel)
plant = gsid.PlantModel.load("plant.json")
assert_type(plant, gsid.PlantModel)
assert_type(gsid.fit_plant(plant, [record]), gsid.PlantFit)
found = gsid.start([record], output="rate")
assert_type(found, gsid.Start)
assert_type(found.model(), gsid.PlantModel)
assert_type(gsid.compare(plant, [record]), gsid.Comparison)
assert_type(gsid.predict(plant, record), list[gsid.PredictedOutput])
assert_type(gsid.diagnose(plant, [record]), gsid.Diagnosis)
assert_type(gsid.diagnose_records([record], time_s=10.0), gsid.Diagnosis)
assert_type(gsid.torque_residual(plant, [record]), gsid.TorqueResidual)
added = gsid.add("coulomb_friction", plant, [record])
assert_type(added, gsid.Addition)
assert_type(added.model, gsid.PlantModel)
assert_type(added.ladder, gsid.Ladder)
assert_type(gsid.position(record), gsid.Position)
assert_type(gsid.undo(added.model), gsid.PlantModel)
assert_type(gsid.studio(record, "other.csv"), gsid.Studio)
