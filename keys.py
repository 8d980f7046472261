from rig.rigs import RIGS
from rig.files.scenario import parse_scenario
from daq.quantity import Quantity
import tomllib
for name in ("impact_beam","planar_slider_crank","spatial_slider_crank"):
    kind=RIGS[name]
    print(name, len(kind.numbers))
    for k,s in kind.numbers.items():
        print("   ",k, s.meaning, kind.value(k,{}), kind.model[k.split('[')[0]].place if k in kind.model else None)
    print(sorted(kind.effects) if hasattr(kind,'effects') else '')
